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
def test_copied_figures_are_the_certified_ones(name):
    """Sum of squares, residual sd, linearised sds and least-squares estimates fit the records."""
    nist_set = certified(name)
    squares = nist_set.squares(nist_set.estimates[None])[0]
    if name == "Lanczos1":  # residuals of 1e-13: the estimates' 11 digits and doubles are too few
        squares = nist_set.squares(nist_set.least_squares[None])[0]
    tolerance = 2e-3 if name == "Lanczos1" else 2 * DIGITS
    assert squares == pytest.approx(nist_set.sum_of_squares, rel=tolerance)
    residual_sd = np.sqrt(nist_set.sum_of_squares / nist_set.freedom)
    assert residual_sd == pytest.approx(nist_set.residual_sd, rel=DIGITS)
    np.testing.assert_allclose(np.linalg.norm(nist_set.factor, axis=1), nist_set.sds, rtol=1e-6)
    printed = 0.5e-10 * 10.0 ** np.floor(np.log10(np.abs(nist_set.estimates)))
    distance = np.abs(nist_set.least_squares - nist_set.estimates)
    assert np.all(distance <= printed + 1e-6 * nist_set.sds)


@pytest.mark.parametrize("name", CURVES)
def test_models_take_many_draws_and_priors_hold_the_posterior(name):
    posterior, nist_set = target(name), certified(name)
    z = np.random.default_rng(1).standard_normal((7, posterior.dimension))
    together = posterior.log_likelihood_of_normal(z)
    alone = [posterior.log_likelihood_of_normal(row[None])[0] for row in z]
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    assert np.isfinite(together).any()
    lower, upper = nist_set.bounds.T
    assert np.all(nist_set.estimates - lower > 4.0 * nist_set.sds)
    assert np.all(upper - nist_set.estimates > 4.0 * nist_set.sds)


@pytest.mark.parametrize("name", ["Misra1a", "Gauss1", "ENSO", "Thurber"])
def test_the_posterior_is_that_of_least_squares_with_the_noise_integrated_out(name):
    posterior, nist_set = target(name), certified(name)
    rng = np.random.default_rng(2)
    b = nist_set.estimates + rng.standard_normal((5, nist_set.sds.size)) @ nist_set.factor.T
    sigma = nist_set.residual_sd * np.geomspace(0.2, 8.0, 2001)
    log_marginal = []
    for row in b:
        values = dict(zip(nist_set.names, row, strict=True))
        theta = np.column_stack(
            [np.full(sigma.size, values.get(n, 0.0)) for n in posterior.names[:-1]] + [sigma]
        )
        density = posterior.log_likelihood(theta) + posterior.prior.log_density(theta)
        log_marginal.append(
            np.log(np.trapezoid(np.exp(density - density.max()), sigma)) + density.max()
        )
    expected = -0.5 * nist_set.y.size * np.log(nist_set.squares(b))
    np.testing.assert_allclose(log_marginal - log_marginal[0], expected - expected[0], atol=1e-6)
