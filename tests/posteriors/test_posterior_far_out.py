"""Proposals far outside the prior: no finite likelihood, counted, and nothing on the screen."""

import warnings

import numpy as np
from tests.validation.calibration import tubular


def test_a_proposal_far_outside_the_prior_fails_in_silence_and_is_counted():
    target = tubular("voigt_kelvin_2")
    z = np.zeros((3, target.dimension))
    z[1] = 900.0
    z[2] = -900.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = target.log_likelihood_of_normal(z)
    assert np.isfinite(values).tolist() == [True, False, False]
    assert (target.failures.evaluations, target.failures.failed) == (3, 2)
