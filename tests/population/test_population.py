"""Populations: their likelihood, shrinkage and new specimens, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from tests.shared.populations import World, parameter, world

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.population.coordinate import Coordinate
from deabayes.population.files import weighted_quantiles
from deabayes.population.member import Member
from deabayes.population.model import PopulationModel
from deabayes.population.specimens import (
    Shrunken,
    new_specimens,
    shrink,
    tail_probability,
    warnings_of,
    without,
)
from deabayes.prior.distributions import LogUniform
from deabayes.prior.joint import Prior

MEAN, SPREAD = np.log([2e4, 3.0]), np.array([0.1, 0.3])
FINE = Shrunken(np.full(10, 0.1), 1000.0, 0.1, np.full(2, 0.5), np.full(2, 0.5))
"""An estimate without a cause for a warning."""


@pytest.fixture(scope="module")
def known() -> World:
    rng = np.random.default_rng(1)
    sd = rng.uniform(0.05, 0.6, (6, 2))
    return world(MEAN, SPREAD, sd, rng)


def test_likelihood_of_mean_and_spread_is_the_conjugate_one(known: World) -> None:
    """Also at a spread of nothing, and where the prior is as narrow as the data."""
    rng = np.random.default_rng(2)
    centres = MEAN + 0.3 * rng.standard_normal((200, 2))
    spreads = np.abs(rng.standard_normal((200, 2))) * [[0.3, 0.3]]
    spreads[:50] = 1e-9
    found, exact = (
        values - values[0]
        for values in (w.log_likelihood(centres, spreads) for w in (known.model, known))
    )
    assert np.max(np.abs(found - exact)) < 0.03 * np.ptp(exact)
    near = exact > exact.max(axis=0) - 3.0
    assert np.max(np.abs(found - exact)[near]) < 0.2


def test_shrinkage_of_a_normal_specimen(known: World) -> None:
    """Posterior mean lambda m + (1 - lambda) y, lambda = sd^2 / (sd^2 + s^2)."""
    centres, spreads = np.tile(MEAN, (3, 1)), np.tile(SPREAD, (3, 1))
    for index, (y, sd) in enumerate(zip(known.y, known.sd, strict=True)):
        found = shrink(known.model, index, centres, spreads, (centres, spreads))
        share = sd**2 / (sd**2 + SPREAD**2)
        assert found.weights.sum() == pytest.approx(1.0)
        assert found.shrinkage == pytest.approx(share, abs=0.03)
        after = np.sqrt(share) * SPREAD
        phi = known.model.members[index].phi
        error = np.abs(found.weights @ phi - (share * MEAN + (1 - share) * y)) / after
        assert np.all(error < 5 / np.sqrt(found.effective_draws) + 0.02)
        variance = found.weights @ (phi - found.weights @ phi) ** 2
        assert np.sqrt(variance) == pytest.approx(after, rel=0.2)


def test_draws_of_the_population_have_equal_weight_in_shrinkage(known: World) -> None:
    """Each (m, s) counts by its place in the population's posterior, not by the specimen again."""
    centres = MEAN + np.array([[-0.4, 0.0], [0.4, 0.0]])
    spreads = np.full((2, 2), 0.2)
    index = int(np.argmax(known.sd[:, 0]))
    found = shrink(known.model, index, centres, spreads, (centres, spreads))
    y, sd = known.y[index], known.sd[index]
    share = sd**2 / (sd**2 + 0.04)
    expected = np.mean(share * centres + (1 - share) * y, axis=0)
    after = found.weights @ known.model.members[index].phi
    assert after == pytest.approx(expected, abs=0.06)


def test_a_specimen_far_from_the_population_is_warned_of(known: World) -> None:
    centres = np.tile(MEAN, (3, 1))
    centres[:, 0] += 3.0
    spreads = np.full((3, 2), 0.02)
    far = [shrink(known.model, index, centres, spreads, (centres, spreads)) for index in range(6)]
    assert not any(each.reliable for each in far)
    words = warnings_of(known.model, far, 0.0)
    assert all(
        any(f"strip_{k}" in w and "do not use its shrunken" in w for w in words) for k in range(6)
    )
    assert warnings_of(known.model, [FINE] * 6, 0.0) == []


def test_how_far_out_a_specimen_lies(known: World) -> None:
    """With m and s known, phi_i ~ N(y', v) has P = Phi((y' - m) / sqrt(s^2 + v))."""
    member = known.model.members[2]
    centres, spreads = np.tile(MEAN, (5, 1)), np.tile(SPREAD, (5, 1))
    found = tail_probability(member.phi, centres, spreads)
    middle, variance = member.phi.mean(axis=0), member.phi.var(axis=0)
    below = ndtr((middle - MEAN) / np.sqrt(SPREAD**2 + variance))
    assert found == pytest.approx(2 * np.minimum(below, 1 - below), abs=0.08)


def test_a_specimen_that_does_not_belong_is_warned_of(known: World) -> None:
    """Judged by the others, though it has widened the population of all of them."""
    rng = np.random.default_rng(12)
    members = list(known.model.members)
    away = np.array([3.0, 0.0])
    odd = replace(members[0].likelihood, means=members[0].likelihood.means + away)
    phi = members[0].phi + away
    members[0] = replace(members[0], likelihood=odd, phi=phi)
    model = replace(known.model, members=tuple(members))
    z = rng.standard_normal((100_000, 4))
    by_member = model.log_likelihood(*model.split(model.prior.to_parameters(z)))

    def drawn(log_weights: FloatArray) -> FloatArray:
        weights = np.exp(log_weights - log_weights.max())
        return z[rng.choice(len(z), 1000, p=weights / weights.sum())]

    found = tail_probability(phi, *without(model, 0, drawn(by_member.sum(axis=1)), rng))
    others = model.prior.to_parameters(drawn(by_member[:, 1:].sum(axis=1)))
    exact = tail_probability(phi, *model.split(others))
    assert found[0] < 0.005 < found[1]
    assert found == pytest.approx(exact, rel=0.3, abs=0.003)
    words = warnings_of(known.model, [replace(FINE, tail_probability=found)] * 6, 0.0)
    assert all("whether it belongs to this population" in w and "a (" in w for w in words)
    assert len(words) == 6


def test_uninformative_records_and_skewed_posteriors_are_warned_of(known: World) -> None:
    members = [replace(m, contraction={"a": 0.02, "b": 0.9}) for m in known.model.members]
    members[5] = replace(members[5], told=np.array([False, True]))
    likelihood = replace(members[0].likelihood, misfit=0.2)
    members[0] = replace(members[0], likelihood=likelihood)
    words = warnings_of(replace(known.model, members=tuple(members)), [FINE] * 6, 0.2)
    assert sum("hardly inform a; bounds and order" in word for word in words) == 5
    assert sum("strip_5: its records do not inform a; there" in word for word in words) == 1
    assert any("not well described" in word and "strip_0" in word for word in words)
    assert any("drawn again" in word for word in words)


def test_new_specimens_scatter_about_the_mean(known: World) -> None:
    rng = np.random.default_rng(3)
    theta, outside = new_specimens(
        known.model, np.tile(MEAN, (40000, 1)), np.tile(SPREAD, (40000, 1)), rng
    )
    phi = np.log(theta)
    assert outside == 0.0
    assert phi.mean(axis=0) == pytest.approx(MEAN, abs=0.01)
    assert phi.std(axis=0) == pytest.approx(SPREAD, rel=0.02)


def test_new_specimens_keep_the_order_and_the_bounds() -> None:
    rng = np.random.default_rng(9)
    times = [parameter(f"tau_{k}", LogUniform(0.1, 1e3), "s", ordered="tau") for k in (1, 2)]
    prior = Prior(times)
    coordinate = Coordinate.of(times)
    model = PopulationModel.of(
        coordinate, [Member.of("one", prior.sample(rng, 4000), prior, coordinate, 4000.0)]
    )
    centres, spreads = np.tile(np.log([3.0, 9.0]), (2000, 1)), np.full((2000, 2), 0.5)
    theta, outside = new_specimens(model, centres, spreads, rng)
    assert 0.1 < outside < 0.6
    assert np.all(theta[:, 1] >= 2.0 * theta[:, 0])
    with pytest.raises(UserError, match="outside of all members' priors"):
        new_specimens(model, centres + 50.0, spreads, rng)


def test_weighted_quantiles() -> None:
    rng = np.random.default_rng(10)
    values = rng.standard_normal(20000)
    weights = np.exp(values)  # tilts N(0, 1) to N(1, 1)
    found = weighted_quantiles(values, weights / weights.sum(), [0.05, 0.5, 0.95])
    assert found == pytest.approx([1 - 1.645, 1.0, 1 + 1.645], abs=0.1)
