"""Simulated specimens of the long checks: what they are drawn from, and their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deabayes.posteriors.problem import problem_of
from tests.validation.cases import case
from tests.validation.membrane_worlds import doubling_grid, membrane
from tests.validation.recovery import in_own_ranges
from tests.validation.structure_worlds import at_rest, in_motion
from tests.validation.tubular_worlds import tubular
from tests.validation.worlds import given, log_time, noise_of, responded, simulate, smooth_error


def test_spacings_double_and_a_denser_grid_contains_the_usual_times():
    grid, dense = doubling_grid(), doubling_grid(refined=5)
    assert grid.size == 155 and grid[0] == 0.25 and grid[-1] == 595.0
    assert set(np.diff(grid)) == {0.25, 0.5, 1.0, 2.0, 4.0, 8.0}
    assert dense.size == 5 * 155
    np.testing.assert_allclose(dense[4::5], grid)


@pytest.mark.parametrize("order", [1, 3])
def test_most_draws_of_the_membrane_prior_survive_the_highest_voltage(order):
    target = membrane().target(order)
    theta = target.prior.sample(np.random.default_rng(1), 200)
    responses = target.responses(theta)["step_4kV"]
    assert 0.9 < np.isfinite(responses).all(axis=1).mean() <= 1.0


def test_innovations_of_simulated_records_at_the_truth_are_standard_normal():
    world = membrane()
    target = world.target(2)
    found = []
    for seed in range(5):
        data = simulate(world, target, np.random.default_rng(seed))
        theta = np.array([[data.truth[name][0] for name in target.names]])
        clean = target.responses(theta)
        for record in data.records:
            noise = noise_of(target, data.truth, record)
            residuals = record.response - clean[record.name]
            weights = 1.0 / record.samples_averaged
            found.append(target.noise.innovations(residuals, record.coordinate, weights, noise))
    innovations = np.concatenate(found, axis=None)
    assert innovations.size == 5 * 3 * 155
    assert innovations.mean() == pytest.approx(0.0, abs=4 / np.sqrt(innovations.size))
    assert innovations.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / innovations.size))


def test_a_specimen_that_is_pulled_in_is_drawn_again():
    world = membrane()
    target = world.target(1)
    first = np.random.default_rng(3)

    class TwoDraws:
        """A prior whose first draw is far too soft."""

        names = target.prior.names
        drawn = 0

        def sample(self, rng, n):
            self.drawn += 1
            theta = target.prior.to_parameters(np.zeros((n, target.dimension)))
            if self.drawn == 1:
                theta[:, self.names.index("mu_alpha")] = 5e3
            return theta

    prior = TwoDraws()
    data = simulate(world, replace(target, prior=prior), first)
    assert prior.drawn == 2
    assert [e.name for e in data.records] == ["step_2kV", "step_3kV", "step_4kV"]
    assert [e.name for e in data.held_out] == ["step_3.5kV", "sine_2kV"]
    assert all(np.isfinite(e.response).all() for e in data.held_out)
    assert data.truth["mu_alpha"][0] == pytest.approx(35e3)


def test_given_records_change_the_likelihood_but_not_the_prior():
    world = tubular()
    target = world.target(1)
    data = simulate(world, target, np.random.default_rng(4))
    conditioned = given(target, data.records)
    z = np.random.default_rng(5).standard_normal((5, target.dimension))
    assert conditioned.prior is target.prior
    assert not np.allclose(conditioned(z), target(z))


def test_a_fit_has_correlated_noise_in_shares_of_each_records_own_range():
    world = membrane()
    target = world.target(1)
    data = simulate(world, target, np.random.default_rng(4))
    fit = in_own_ranges(given(target, data.records))
    for record, experiment in zip(fit.records, data.records, strict=True):
        true = noise_of(target, data.truth, experiment)["sigma_ou"]
        fitted = fit.noise_draws(data.truth, record)["sigma_ou"]
        assert fitted == pytest.approx(true, rel=0.05)
    pairs = zip(fit.records, target.records, strict=True)
    assert not any(a.correlated_scale == pytest.approx(b.correlated_scale) for a, b in pairs)


def test_discrepancy_is_smooth_and_of_the_stated_size():
    record = membrane().target(1).records[0].experiment
    rng = np.random.default_rng(6)
    errors = np.stack([smooth_error(rng, log_time, record) for _ in range(300)])
    size = errors.std() / record.response_range
    assert size == pytest.approx(0.01, rel=0.1)
    late = record.coordinate > 50.0
    slope = np.diff(errors[:, late]) / np.diff(np.log(record.coordinate[late]))
    assert slope.std() / record.response_range == pytest.approx(0.01, rel=0.2)


def test_failed_specimens_give_nan_records():
    target = membrane().target(1)
    theta = target.prior.to_parameters(np.zeros((1, target.dimension)))
    truth = {**target.draws(theta), "mu_alpha": np.array([5e3])}
    noise = target.noise_draws(truth, target.records[0])
    record = target.records[2].experiment
    assert np.isnan(
        responded(target, truth, noise, record, np.random.default_rng(7)).response
    ).all()


@pytest.mark.parametrize(("groups", "dimension"), [("protocol", 14), ("experiment", 20)])
def test_cases_have_the_dimensions_of_the_joint_fit(groups, dimension):
    target = case("P", groups)
    assert target.dimension == dimension
    again = case("P", groups)
    for one, other in zip(target.records, again.records, strict=True):
        np.testing.assert_array_equal(one.experiment.response, other.experiment.response)


@pytest.mark.parametrize(("world", "order"), [(at_rest(), 2), (in_motion(), 2)])
def test_most_structures_of_the_prior_stay_bent(world, order):
    """Of 100 draws at rest, 15 would not stay at their rest angle: such draws have no force."""
    target = world.target(order)
    theta = target.prior.sample(np.random.default_rng(2), 100)
    for responses in target.responses(theta).values():
        assert np.isfinite(responses).all(axis=1).mean() > 0.8
    data = simulate(world, target, np.random.default_rng(0))
    assert len(data.held_out) == 1
    assert set(data.truth) == set(target.names)
    assert np.isfinite(given(target, data.records).log_likelihood(theta[:3])).any()


def test_two_relaxation_units_have_hops_and_one_has_none():
    membranes = membrane().target(2)
    (hop,) = problem_of(membranes).hops
    (units,) = hop.groups
    assert [membranes.names[k] for k in units.columns[0]] == ["tau_beta_1", "tau_beta_2"]
    assert problem_of(membrane().target(1)).hops == ()
