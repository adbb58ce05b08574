"""NIST's regression sets: copied without an error, and a posterior with the known shape."""

from __future__ import annotations

import numpy as np
import pytest

from tests.validation.nist import target
from tests.validation.nist_models import CURVES
from tests.validation.nist_sets import certified

DIGITS = 1e-10
"""Certified figures have 11 digits."""


@pytest.mark.parametrize("name", CURVES)
def test_sum_of_squares_and_residual_sd_are_the_certified_ones(name):
    found = certified(name)
    squares = found.squares(found.estimates[None])[0]
    if name == "Lanczos1":  # residuals of 1e-13: the estimates' 11 digits and doubles are too few
        squares = found.squares(found.least_squares[None])[0]
        assert squares == pytest.approx(found.sum_of_squares, rel=2e-3)
    else:
        assert squares == pytest.approx(found.sum_of_squares, rel=2 * DIGITS)
    residual_sd = np.sqrt(found.sum_of_squares / found.freedom)
    assert residual_sd == pytest.approx(found.residual_sd, rel=DIGITS)


@pytest.mark.parametrize("name", CURVES)
def test_linearised_sds_are_the_certified_ones(name):
    found = certified(name)
    np.testing.assert_allclose(np.linalg.norm(found.factor, axis=1), found.sds, rtol=1e-6)


@pytest.mark.parametrize("name", CURVES)
def test_certified_estimates_are_those_of_least_squares(name):
    found = certified(name)
    printed = 0.5e-10 * 10.0 ** np.floor(np.log10(np.abs(found.estimates)))
    distance = np.abs(found.least_squares - found.estimates)
    assert np.all(distance <= printed + 1e-6 * found.sds)


@pytest.mark.parametrize("name", CURVES)
def test_models_take_many_draws_and_priors_hold_the_posterior(name):
    posterior, found = target(name), certified(name)
    z = np.random.default_rng(1).standard_normal((7, posterior.dimension))
    together = posterior.log_likelihood_of_normal(z)
    alone = [posterior.log_likelihood_of_normal(row[None])[0] for row in z]
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    assert np.isfinite(together).any()
    below, above = (found.estimates - found.bounds[:, 0], found.bounds[:, 1] - found.estimates)
    assert np.all(np.minimum(below, above) > 4.0 * found.sds)


@pytest.mark.parametrize("name", ["Misra1a", "Gauss1", "ENSO", "Thurber"])
def test_the_posterior_is_that_of_least_squares_with_the_noise_integrated_out(name):
    posterior, found = target(name), certified(name)
    rng = np.random.default_rng(2)
    b = found.estimates + rng.standard_normal((5, found.sds.size)) @ found.factor.T
    sigma = found.residual_sd * np.geomspace(0.2, 8.0, 2001)
    log_marginal = []
    for row in b:
        values = dict(zip(found.names, row, strict=True))
        theta = np.column_stack(
            [np.full(sigma.size, values.get(n, 0.0)) for n in posterior.names[:-1]] + [sigma]
        )
        density = posterior.log_likelihood(theta) + posterior.prior.log_density(theta)
        log_marginal.append(
            np.log(np.trapezoid(np.exp(density - density.max()), sigma)) + density.max()
        )
    expected = -0.5 * found.y.size * np.log(found.squares(b))
    np.testing.assert_allclose(log_marginal - log_marginal[0], expected - expected[0], atol=1e-6)
