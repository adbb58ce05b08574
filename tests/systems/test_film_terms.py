"""A structure's film: the sampler's coordinates of terms that are parts of one stress."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.coordinates import check_there_and_back, coordinates_of, parts_of
from tests.shared.structure_contexts import force
from tests.shared.structures import PLAIN

from deabayes.inference.log_posterior import LogPosterior, build
from deabayes.posteriors.problem import problem_of
from deabayes.prior.coordinates import Inherited
from deabayes.study import Study
from deabayes.systems.ridges.units import Shares, UnitHop

STRETCHES = 5.0 / np.sqrt(2.0), 1.0 / (5.0 * 5.0 / np.sqrt(2.0))
"""lambda_x and lambda_z of the film at rest: 45 degrees, prestretch 5."""


def film(candidate: str, **priors: object) -> LogPosterior:
    study = Study("study", Path(), (candidate,), priors=priors)
    return build(study, candidate, PLAIN, [force(5.0)])


def inherited(candidate: str) -> LogPosterior:
    """Under a posterior along a bent ridge of the terms, as forces leave it."""
    posterior = film(candidate)
    u = np.random.default_rng(3).standard_normal((4000, posterior.dimension))
    u[:, 1] = 0.4 * u[:, 3] ** 2 + 0.05 * u[:, 1]
    handed_on = [n for n in posterior.names if not n.startswith("quasi_static")]
    kept = [posterior.names.index(n) for n in handed_on]
    draws = posterior.prior.to_parameters(u)[:, kept]
    posterior.prior = posterior.prior.inherit(handed_on, draws)
    return posterior


@pytest.mark.parametrize("of", [film, inherited])
@pytest.mark.parametrize("candidate", ["ogden_2", "ogden_3"])
def test_there_and_back_with_the_jacobian(of, candidate) -> None:
    posterior = of(candidate)
    assert len(parts_of(posterior, Inherited)) == (of is inherited)
    z = np.random.default_rng(1).standard_normal((100, posterior.dimension))
    check_there_and_back(coordinates_of(posterior), z, jacobian=1e-4)


@pytest.mark.parametrize("of", [film, inherited])
def test_what_adds_up_is_the_stress_at_rest(of) -> None:
    posterior = of("ogden_3")
    (shares,) = parts_of(posterior, Shares)
    assert [posterior.names[k] for k in shares.sizes] == ["mu_1", "mu_2", "mu_3"]
    z = np.random.default_rng(2).standard_normal((50, posterior.dimension))
    theta = posterior.prior.to_parameters(z)
    mu, alpha = theta[:, list(shares.sizes)], theta[:, list(shares.places)]
    parts = mu * (STRETCHES[0] ** alpha - STRETCHES[1] ** alpha)
    u, _ = coordinates_of(posterior).straighten(z)
    np.testing.assert_allclose(np.exp(u[:, shares.sizes[0]]), parts.sum(axis=1))
    prior = posterior.prior.parameters[shares.places[0]].prior
    middle, sd = (prior.lower + prior.upper) / 2.0, (prior.upper - prior.lower) / np.sqrt(12.0)
    mean = (parts * alpha).sum(axis=1) / parts.sum(axis=1)
    np.testing.assert_allclose(middle + sd * u[:, shares.places[0]], mean)


@pytest.mark.parametrize("of", [film, inherited])
def test_of_two_terms_the_standard_deviation_of_exponents_is_a_coordinate(of) -> None:
    """Each weighted by its stress at rest: along a ridge of other shares it stays what it is."""
    posterior = of("ogden_2")
    (shares,) = parts_of(posterior, Shares)
    z = np.random.default_rng(4).standard_normal((50, posterior.dimension))
    theta = posterior.prior.to_parameters(z)
    mu, alpha = theta[:, list(shares.sizes)], theta[:, list(shares.places)]
    parts = mu * (STRETCHES[0] ** alpha - STRETCHES[1] ** alpha)
    weights = parts / parts.sum(axis=1, keepdims=True)
    mean = (weights * alpha).sum(axis=1, keepdims=True)
    prior = posterior.prior.parameters[shares.places[0]].prior
    sd = (prior.upper - prior.lower) / np.sqrt(12.0)
    u, _ = coordinates_of(posterior).straighten(z)
    expected = np.sqrt((weights * (alpha - mean) ** 2).sum(axis=1))
    np.testing.assert_allclose(sd * u[:, shares.places[1]], expected, rtol=1e-9)


def test_a_hop_keeps_the_stress_of_a_term() -> None:
    posterior = film("ogden_2")
    (hop,), rng = problem_of(posterior).hops, np.random.default_rng(1)
    assert isinstance(hop, UnitHop)
    z = rng.standard_normal((500, posterior.dimension))
    moved, factor = hop(z, rng)
    before, after = (
        np.sort(_stresses(posterior, posterior.prior.to_parameters(each)), axis=1)
        for each in (z, moved)
    )
    np.testing.assert_allclose(after, before, rtol=1e-6)
    assert np.isfinite(factor).mean() > 0.95


def _stresses(posterior: LogPosterior, theta: np.ndarray) -> np.ndarray:
    mu, alpha = (
        theta[:, [posterior.names.index(f"{name}_{i}") for i in (1, 2)]] for name in ("mu", "alpha")
    )
    return mu * (STRETCHES[0] ** alpha - STRETCHES[1] ** alpha)
