"""A structure's film: the sampler's coordinates of terms that are parts of one stress."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
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


@cache
def inherited(candidate: str) -> LogPosterior:
    """Under a posterior along a bent ridge of the terms, as forces leave it."""
    posterior = film(candidate)
    u = np.random.default_rng(3).standard_normal((2000, posterior.dimension))
    u[:, 1] = 0.4 * u[:, 3] ** 2 + 0.05 * u[:, 1]
    names = [n for n in posterior.names if not n.startswith("quasi_static")]
    kept = [posterior.names.index(n) for n in names]
    draws = posterior.prior.to_parameters(u)[:, kept]
    return replace(posterior, prior=posterior.prior.inherit(names, draws))


def stresses(posterior: LogPosterior, theta: np.ndarray) -> np.ndarray:
    """Stress of every term at rest (W, n)."""
    mu, alpha = (
        theta[:, [k for k, n in enumerate(posterior.names) if n.startswith(name)]]
        for name in ("mu_", "alpha_")
    )
    return mu * (STRETCHES[0] ** alpha - STRETCHES[1] ** alpha)


@pytest.mark.parametrize("of", [film, inherited])
@pytest.mark.parametrize("candidate", ["ogden_2", "ogden_3"])
def test_there_and_back_with_the_jacobian(of, candidate) -> None:
    posterior = of(candidate)
    assert len(parts_of(posterior, Inherited)) == (of is inherited)
    z = np.random.default_rng(1).standard_normal((100, posterior.dimension))
    check_there_and_back(coordinates_of(posterior), z, jacobian=1e-4)


@pytest.mark.parametrize("of", [film, inherited])
@pytest.mark.parametrize("candidate", ["ogden_2", "ogden_3"])
def test_coordinates_are_total_stress_and_mean_exponent_at_rest(of, candidate) -> None:
    """Of two terms also the exponents' standard deviation, each weighted by its stress at rest."""
    posterior = of(candidate)
    (shares,) = parts_of(posterior, Shares)
    assert [posterior.names[k][:3] for k in shares.sizes] == ["mu_"] * len(shares.sizes)
    z = np.random.default_rng(2).standard_normal((50, posterior.dimension))
    theta = posterior.prior.to_parameters(z)
    parts, alpha = stresses(posterior, theta), theta[:, list(shares.places)]
    u, _ = coordinates_of(posterior).straighten(z)
    np.testing.assert_allclose(np.exp(u[:, shares.sizes[0]]), parts.sum(axis=1))
    prior = posterior.prior.parameters[shares.places[0]].prior
    middle, sd = (prior.lower + prior.upper) / 2.0, (prior.upper - prior.lower) / np.sqrt(12.0)
    weights = parts / parts.sum(axis=1, keepdims=True)
    mean = (weights * alpha).sum(axis=1)
    np.testing.assert_allclose(middle + sd * u[:, shares.places[0]], mean)
    if candidate == "ogden_2":
        expected = np.sqrt((weights * (alpha - mean[:, None]) ** 2).sum(axis=1))
        np.testing.assert_allclose(sd * u[:, shares.places[1]], expected, rtol=1e-9)


def test_a_hop_keeps_the_stress_of_a_term() -> None:
    posterior = film("ogden_2")
    (hop,), rng = problem_of(posterior).hops, np.random.default_rng(1)
    assert isinstance(hop, UnitHop)
    z = rng.standard_normal((500, posterior.dimension))
    moved, factor = hop(z, rng)
    before, after = (
        np.sort(stresses(posterior, posterior.prior.to_parameters(each)), axis=1)
        for each in (z, moved)
    )
    np.testing.assert_allclose(after, before, rtol=1e-6)
    assert np.isfinite(factor).mean() > 0.95
