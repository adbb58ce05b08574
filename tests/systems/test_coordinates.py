"""Coordinates of the sampler: there and back, with their Jacobian, inside the prior's support."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.shared.coordinates import (
    COORDINATES,
    SLOPES,
    WEIGHT,
    check_there_and_back,
    coordinates_of,
    parts_of,
)
from tests.validation.tubular_worlds import tubular_full

from deabayes.experiment import Quantity, Specimen
from deabayes.noise.base import NoisePair
from deabayes.prior.coordinates import Inherited, Natural
from deabayes.prior.distributions import LogNormal, LogUniform, Uniform
from deabayes.prior.ordered import Ordered
from deabayes.sampling.problem import Coordinates
from deabayes.sampling.proposal import fit
from deabayes.systems.ridges.terms import GentPair
from deabayes.systems.springs.stretched import StretchedSpring, equal_biaxial


def draws(n=2000, seed=0):
    return np.random.default_rng(seed).standard_normal((n, 6))


def test_there_and_back_with_the_jacobian():
    check_there_and_back(COORDINATES, draws(20), jacobian=1e-6)
    z = 1.5 * draws()
    u, _ = COORDINATES.straighten(z)
    np.testing.assert_allclose(COORDINATES.bend(u), z, atol=1e-8)
    assert np.abs(u - z).max() > 0.1


def test_without_parts_they_are_those_of_z():
    z = draws(5)
    u, log_jacobian = Coordinates().straighten(z)
    assert u is z and Coordinates().bend(z) is z and not log_jacobian.any()


def test_logarithms_of_times_and_values_of_uniform_parameters():
    z = draws(5)
    u, _ = COORDINATES.straighten(z)
    ordered, alone = (part.block for part in COORDINATES.parts[:2])
    np.testing.assert_allclose(np.exp(u[:, [0, 1]]), ordered.to_parameters(z[:, [0, 1]]))
    values = 2.0 + 6.0 / np.sqrt(12.0) * u[:, [2]]
    np.testing.assert_allclose(values, alone.to_parameters(z[:, [2]]))
    np.testing.assert_array_equal(u[:, 5], z[:, 5])


@pytest.mark.parametrize("from_largest", [False, True])
@pytest.mark.parametrize(
    "prior",
    [LogNormal(2.0, 0.7), LogUniform(0.01, 10.0), Uniform(-8.0, 8.0)],
    ids=lambda p: p.label,
)
def test_three_in_order_of_any_kind(prior, from_largest):
    block = Ordered.of(
        "x", (0, 1, 2), prior, 1.0 if prior.label == "uniform" else 1.5, from_largest
    )
    there = Coordinates((Natural(block),))
    z = np.random.default_rng(4).standard_normal((200, 3))
    u, theta = there.straighten(z)[0], block.to_parameters(z)
    if prior.label == "uniform":
        np.testing.assert_allclose(16.0 / np.sqrt(12.0) * u, theta, atol=1e-12)
    else:
        np.testing.assert_allclose(u, np.log(theta), atol=1e-12)
    check_there_and_back(there, z, jacobian=1e-6)
    unordered = u[:, [0, 2, 1]]
    assert np.isnan(there.bend(unordered)).all()


def test_noises_that_share_one_variance_lie_on_a_line():
    angle = np.linspace(0.01, 0.5 * np.pi - 0.01, 50)
    white, correlated = 0.3 * np.cos(angle) / np.sqrt(WEIGHT), 0.3 * np.sin(angle)
    z = np.zeros((50, 6))
    z[:, 3], z[:, 4] = np.log(white) / SLOPES[0], np.log(correlated) / SLOPES[1]
    u, _ = COORDINATES.straighten(z)
    np.testing.assert_allclose(u[:, 3], np.log(0.3))
    np.testing.assert_allclose(u[:, 4], np.log(np.tan(angle)))


SPRING = StretchedSpring(
    "mu", "J", (3 - 3**-5, 3.4 - 3.4**-5), (2 * 9 + 1 / 81 - 3, 2 * 3.4**2 + 3.4**-4 - 3)
)


def _load(stretch, limit):
    """P(lambda) / mu of a Gent spring under equal-biaxial stretch."""
    invariant = 2 * stretch**2 + stretch**-4 - 3
    return (stretch - stretch**-5) / (1 - invariant / limit)


def test_gent_springs_that_take_up_one_load_lie_on_a_line():
    """mu and J that take up one load from stretch 3 to 3.4 have one u_1, whatever J."""
    pair = GentPair(SPRING, (0, 1), 0.8, np.log(100.0), 0.7)
    limit = np.geomspace(22.0, 3000.0, 40)
    modulus = 2.0 / (_load(3.4, limit) - _load(3.0, limit))
    z = np.column_stack([np.log(modulus) / 0.8, np.log(limit / 100.0) / 0.7])
    u = z.copy()
    assert pair.straighten(u) == 0.0
    np.testing.assert_allclose(u[:, 0], np.log(2.0) / 0.8, atol=1e-12)
    np.testing.assert_array_equal(u[:, 1], z[:, 1])
    pair.bend(u)
    np.testing.assert_allclose(u, z, atol=1e-12)


def test_a_spring_that_seems_locked_is_reached_all_the_same():
    """A record read wrong, with stretches beyond lock-up, must not cut off any limit."""
    spring = replace(SPRING, invariants=(50.0, 60.0))
    locking = Coordinates((GentPair(spring, (0, 1), 0.8, np.log(100.0), 0.7),))
    z = np.random.default_rng(5).standard_normal((4000, 3))
    locked = 100.0 * np.exp(0.7 * z[:, 1]) <= 60.0
    assert 0.1 < locked.mean() < 0.5
    u, log_jacobian = locking.straighten(z)
    np.testing.assert_allclose(locking.bend(u), z, atol=1e-12)
    np.testing.assert_array_equal(log_jacobian, 0.0)
    frozen = fit(z, 2, np.random.default_rng(6), np.zeros(4000), coordinates=locking)
    assert np.isfinite(frozen.log_density(z)).all()
    drawn = frozen.sample(np.random.default_rng(7), 4000)
    assert (100.0 * np.exp(0.7 * drawn[:, 1]) <= 60.0).mean() == pytest.approx(
        locked.mean(), abs=0.05
    )


def test_outside_of_the_support_is_no_place():
    u, _ = COORDINATES.straighten(draws(4))
    u[0, 0] = u[0, 1] + 0.1
    u[1, 2] = np.sqrt(3.0) + 0.1
    inside = np.isfinite(COORDINATES.bend(u)).all(axis=1)
    assert inside.tolist() == [False, False, True, True]


def test_far_out_nothing_is_infinitely_likely():
    z = 40.0 * draws(500)
    u, log_jacobian = COORDINATES.straighten(z)
    assert np.isfinite(u).all()
    assert not np.isnan(log_jacobian).any() and (log_jacobian < np.inf).all()


def test_a_proposal_of_the_prior_is_a_density_and_draws_from_it():
    """Over draws of a wide normal, the mean of q / N is the share of q inside the support."""
    rng, z = np.random.default_rng(1), draws(4000)
    frozen = fit(z, 4, rng, coordinates=COORDINATES)
    assert frozen.parts[0].warp is not None
    fresh = draws(400_000, seed=2)
    log_wide = -0.5 * (fresh**2 + np.log(2 * np.pi)).sum(axis=1) - 6 * np.log(1.5)
    share = np.exp(frozen.log_density(1.5 * fresh) - log_wide).mean()
    drawn = COORDINATES.bend(frozen._draw(rng, 20_000))
    inside = np.isfinite(drawn).all(axis=1)
    assert 0.5 < inside.mean() < 0.98
    assert share == pytest.approx(inside.mean(), abs=0.02)
    sampled = frozen.sample(rng, 20_000)
    assert np.isfinite(sampled).all()
    weights = np.exp(-0.5 * (sampled**2 + np.log(2 * np.pi)).sum(1) - frozen.log_density(sampled))
    np.testing.assert_allclose(weights @ sampled**2 / weights.sum(), 1.0, atol=0.1)


def test_fitting_in_coordinates_is_fitting_to_them():
    """Covering part and all: the density at z is that at u times |du/dz|."""
    z = draws(3000)
    u, log_jacobian = COORDINATES.straighten(z)
    log_density = -((z[:, 0] - 1.0) ** 2)
    there = fit(z, 2, np.random.default_rng(8), log_density, coordinates=COORDINATES)
    here = fit(u, 2, np.random.default_rng(8), log_density - log_jacobian)
    assert len(there.parts) == 4
    np.testing.assert_allclose(there.log_density(z), here.log_density(u) + log_jacobian)


def test_those_of_a_real_posterior():
    target = tubular_full().target(2)
    averaged = tuple(
        replace(r, experiment=replace(r.experiment, samples_averaged=np.full(r.weights.size, 5.0)))
        for r in target.records
    )
    target = replace(target, records=averaged)
    found, names = coordinates_of(target), target.names
    natural = parts_of(target, Natural)
    assert [[names[k] for k in part.block.columns] for part in natural] == [
        ["tau_1", "tau_2"], ["creep.tau_ou"], ["frequency_response.tau_ou"]
    ]  # fmt: skip
    assert isinstance(natural[0].block, Ordered)
    noises = parts_of(target, NoisePair)
    assert [[names[k] for k in pair.columns] for pair in noises] == [
        [f"{group}.sigma_white", f"{group}.sigma_ou"] for group in ("creep", "frequency_response")
    ]
    z = np.random.default_rng(3).standard_normal((50, target.dimension))
    theta = target.prior.to_parameters(z)
    u, _ = found.straighten(z)
    for pair, group in zip(noises, ("creep", "frequency_response"), strict=True):
        records = [r for r in target.records if r.group == group]
        weights = np.concatenate([r.weights for r in records])
        size = np.mean([r.correlated_scale**2 for r in records])
        white, correlated = theta[:, list(pair.columns)].T
        total = np.sqrt(white**2 * weights.mean() + correlated**2 * size)
        np.testing.assert_allclose(u[:, pair.columns[0]], np.log(total))


def test_parameters_handed_on_as_one_normal_stay_as_they_are():
    target = tubular_full().target(2)
    draws_before = target.prior.sample(np.random.default_rng(4), 500)
    kept = [target.names.index(n) for n in ("tau_1", "tau_2", "creep.sigma_ou", "creep.tau_ou")]
    inherited = target.prior.inherit([target.names[k] for k in kept], draws_before[:, kept])
    target = replace(target, prior=inherited)
    noise = target.names.index("frequency_response.tau_ou")
    assert [part.block.columns for part in parts_of(target, Natural)] == [(noise,)]
    assert len(coordinates_of(target).parts) == 2


def test_a_mixture_handed_on_is_taken_by_its_default_scores():
    """Two modes of one inherited parameter: what it has is what it had without them."""
    target = tubular_full().target(2)
    before = target.prior.sample(np.random.default_rng(5), 2000)
    kept = [target.names.index(n) for n in ("tau_1", "tau_2", "E_0")]
    before[::2, kept[2]] *= 5.0
    usual = coordinates_of(target).straighten(target.prior.to_normal(before))[0]
    inherited = target.prior.inherit([target.names[k] for k in kept], before[:, kept])
    target = replace(target, prior=inherited)
    found = coordinates_of(target)
    (handed_on,) = parts_of(target, Inherited)
    assert handed_on.block.mixture.components > 1
    check_there_and_back(
        found, 1.5 * np.random.default_rng(6).standard_normal((50, target.dimension))
    )
    whole, _ = found.straighten(target.prior.to_normal(before))
    np.testing.assert_allclose(whole, usual, atol=1e-7)


@pytest.mark.parametrize(
    ("response", "value"), [("stretch", 3.4), ("displacement", 0.004), ("area", 0.034**2)]
)
def test_a_membrane_knows_how_far_it_is_stretched(response, value):
    """98 % of the way from the pre-stretch of 3 to 3.4, whatever is recorded."""
    quantities = {"prestretch": Quantity(3.0, "1"), "side_length": Quantity(0.01, "m")}
    specimen = Specimen("m", "membrane", {}, quantities)
    record = SimpleNamespace(response_name=response, response=np.array([0.0, value]))
    (spring,) = equal_biaxial("mu_alpha", "J_alpha", specimen, [record])
    reached = 3.0 + 0.98 * 0.4
    limit = np.array([30.0, 300.0])
    expected = np.log(_load(reached, limit) - _load(3.0, limit))
    np.testing.assert_allclose(spring.log_secant(limit), expected)
    still = SimpleNamespace(response_name="stretch", response=np.array([3.0]))
    assert equal_biaxial("mu_alpha", "J_alpha", specimen, [still]) == ()
