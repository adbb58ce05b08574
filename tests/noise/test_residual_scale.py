"""Residuals as differences and as logarithms of ratios, and the density they give a response."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import lognorm, norm

from deabayes.inference.record_noise import ResidualScale

MEAN = np.array([[1.0, 2.0, 5.0], [1.5, 2.5, 4.0]])
RESPONSE = np.array([1.1, 1.9, 5.5])


@pytest.mark.parametrize("scale", [1.0, 0.2, np.array([0.3, 2.0])])
@pytest.mark.parametrize("proportional", [False, True])
def test_a_response_comes_back_from_its_residuals(scale, proportional):
    found = ResidualScale(scale, proportional)
    residuals = found.residuals(RESPONSE, MEAN)
    again = found.with_residuals(MEAN, residuals)
    np.testing.assert_allclose(again, np.broadcast_to(RESPONSE, MEAN.shape), rtol=1e-14)


def test_differences():
    found = ResidualScale(0.5).residuals(RESPONSE, MEAN)
    np.testing.assert_allclose(found, 2.0 * (RESPONSE - MEAN))


def test_the_density_is_that_of_the_response():
    """r standard normal makes y normal about f, or log-normal with median f."""
    for proportional in (False, True):
        scale = np.array([0.3, 2.0])
        found = ResidualScale(scale, proportional)
        density = norm.logpdf(found.residuals(RESPONSE, MEAN)) + found.log_derivative(RESPONSE)
        if proportional:
            expected = lognorm.logpdf(RESPONSE, scale[:, None], scale=MEAN)
        else:
            expected = norm.logpdf(RESPONSE, MEAN, scale[:, None])
        np.testing.assert_allclose(density, expected, rtol=1e-12)


def test_a_gain_that_is_not_positive_has_no_residual():
    bad = np.array([[1.0, -2.0, 0.0]])
    found = ResidualScale(proportional=True).residuals(RESPONSE, bad)
    assert np.isnan(found[0, 1]) and not np.isfinite(found[0, 2])
