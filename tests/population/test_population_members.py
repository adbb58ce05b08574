"""What one specimen tells a population: its prior divided out, and nothing where it is silent."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.populations import MEDIANS, SIGMAS, parameter, prior_of_two, world

from deabayes.faults import UserError
from deabayes.population.checks import marginal
from deabayes.population.coordinate import Coordinate
from deabayes.population.member import Member, fit
from deabayes.population.model import PopulationModel
from deabayes.prior.distributions import LogNormal, LogUniform, Normal, Uniform
from deabayes.prior.joint import Prior


def test_records_far_narrower_than_the_prior_keep_their_width() -> None:
    """And their correlation: two Ogden constants whose product alone has a prior of its own."""
    rng = np.random.default_rng(3)
    covariance = np.array([[1.0, -0.999], [-0.999, 1.0]]) * 1e-4**2
    phi = rng.multivariate_normal([0.3, -0.2], covariance, 4000)
    prior_phi = rng.standard_normal((20000, 2))
    found = fit(phi, -0.5 * np.sum(phi**2, axis=1), prior_phi, np.array([True, True]), 4000.0, rng)
    np.testing.assert_allclose(found.variances, np.diag(covariance), rtol=0.1)
    correlation = found.covariances[0, 0, 1] / np.prod(np.sqrt(np.diag(found.covariances[0])))
    assert correlation == pytest.approx(-0.999, abs=2e-4)
    assert found.misfit < 0.03


@pytest.mark.parametrize("prior", [LogNormal(1e4, 0.2), LogUniform(1.1e4, 3.6e4)])
def test_the_prior_is_divided_out_whatever_its_law(prior: LogNormal | LogUniform) -> None:
    """Log theta read as log 2e4 +- 0.2: the first prior is as narrow, the second not normal."""
    rng = np.random.default_rng(4)
    joint = Prior([parameter("a", prior)])
    coordinate = Coordinate.of(joint.parameters)
    low, high = (2e3, 8e4) if isinstance(prior, LogNormal) else (1.101e4, 3.599e4)
    grid = np.log(np.geomspace(low, high, 20001))
    theta = np.exp(grid)[:, None]
    density = joint.log_density(theta) + grid - 0.5 * ((grid - np.log(2e4)) / 0.2) ** 2
    weights = np.exp(density - density.max())
    phi = rng.choice(grid, 8000, p=weights / weights.sum())[:, None]
    found = Member.of("one", np.exp(phi), joint, coordinate, 8000.0).likelihood
    assert found.means[0, 0] == pytest.approx(np.log(2e4), abs=0.03)
    assert np.sqrt(found.covariances[0, 0, 0]) == pytest.approx(0.2, rel=0.06)


def test_a_silent_specimen_leaves_the_population_alone() -> None:
    """Its posterior is its prior: the likelihood is flat where any draw is."""
    rng = np.random.default_rng(5)
    prior = prior_of_two()
    coordinate = Coordinate.of(prior.parameters)
    silent = Member.of("silent", prior.sample(rng, 8000), prior, coordinate, 8000.0)
    model = PopulationModel.of(coordinate, [silent])
    centres = np.log(MEDIANS) + np.linspace(-1.0, 1.0, 21)[:, None] * SIGMAS
    found = model.log_likelihood(centres, np.full((21, 2), 0.1))
    assert np.ptp(found) < 0.2


@pytest.mark.parametrize("ordered", [None, "tau"])
def test_silent_specimens_with_bounded_priors_leave_the_population_alone(
    ordered: str | None,
) -> None:
    """Ten of them: their bounds and order are none that the population's mean has."""
    rng = np.random.default_rng(13)
    law = LogUniform(0.1, 1e3)
    prior = Prior([parameter(f"tau_{k}", law, "s", ordered=ordered) for k in (1, 2)])  # type: ignore[arg-type]
    coordinate = Coordinate.of(prior.parameters)
    members = [
        Member.of(f"{k}", prior.sample(rng, 4000), prior, coordinate, 1000.0) for k in range(10)
    ]
    model = PopulationModel.of(coordinate, members)
    middle, sd = members[0].phi.mean(axis=0), members[0].phi.std(axis=0)
    centres = middle + np.linspace(-2.0, 2.0, 41)[:, None] * sd
    assert not any(member.told.any() for member in members)
    assert np.ptp(model.log_likelihood(centres, np.full((41, 2), 0.1)).sum(axis=1)) < 0.1


def test_one_silent_parameter_leaves_the_others_as_they_are() -> None:
    """E tells of log E = 9.5 +- 0.1, nothing of the time."""
    rng = np.random.default_rng(14)
    prior = Prior(
        [parameter("E", LogNormal(1e4, 1.0)), parameter("tau", LogUniform(0.1, 1e3), "s")]
    )
    coordinate = Coordinate.of(prior.parameters)
    theta = prior.sample(rng, 8000)
    precision = 0.1**-2 + 1.0
    middle = (9.5 * 0.1**-2 + np.log(1e4)) / precision
    theta[:, 0] = np.exp(middle + rng.standard_normal(8000) / np.sqrt(precision))
    found = Member.of("one", theta, prior, coordinate, 8000.0)
    assert found.told.tolist() == [True, False]
    assert found.likelihood.means[:, 0] == pytest.approx(9.5, abs=0.02)
    assert np.sqrt(found.likelihood.variances[0]) == pytest.approx(0.1, rel=0.05)
    assert found.likelihood.variances[1] > 500.0 * found.prior_sd[1] ** 2


def test_parameters_with_normal_priors_always_count_as_informed() -> None:
    """Readings as wide as three priors: their posterior is the prior to within its noise."""
    rng = np.random.default_rng(15)
    members = world(np.array([9.0, 1.0]), np.zeros(2), np.full((30, 2), 3.0), rng).model.members
    assert all(member.told.all() for member in members)


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_weak_information_under_a_bounded_prior_is_kept(shift: float) -> None:
    """A likelihood three quarters as wide as the uniform prior, off its middle or not."""
    rng = np.random.default_rng(16)
    grid = np.linspace(-2.0, 2.0, 8001)
    likelihood = np.exp(-0.5 * ((grid - shift) / 1.5) ** 2)
    phi = rng.choice(grid, 8000, p=likelihood / likelihood.sum())[:, None]
    joint = Prior([parameter("a", Uniform(-2.0, 2.0))])
    member = Member.of("one", phi, joint, Coordinate.of(joint.parameters), 8000.0)
    assert member.told.all()


def test_two_peaks_keep_their_shares() -> None:
    """0.75 N(-1, 0.1^2) + 0.25 N(1.5, 0.4^2) under the prior N(0, 1)."""
    rng = np.random.default_rng(6)
    x = np.linspace(-4, 4, 40001)
    peaks = 0.75 * np.exp(-0.5 * ((x + 1) / 0.1) ** 2) / 0.1
    likelihood = peaks + 0.25 * np.exp(-0.5 * ((x - 1.5) / 0.4) ** 2) / 0.4
    posterior = likelihood * np.exp(-0.5 * x**2)
    phi = rng.choice(x, 8000, p=posterior / posterior.sum())[:, None]
    prior_phi = rng.standard_normal((20000, 1))
    found = fit(phi, -0.5 * phi[:, 0] ** 2, prior_phi, np.array([True]), 8000.0, rng)
    assert len(found.log_weights) == 2
    shares = np.exp(found.log_weights) / np.exp(found.log_weights).sum()
    order = np.argsort(found.means[:, 0])
    assert shares[order] == pytest.approx([0.75, 0.25], abs=0.03)
    assert found.means[order, 0] == pytest.approx([-1.0, 1.5], abs=0.05)
    assert found.misfit < 0.03


def test_marginal_prior_of_an_inherited_one() -> None:
    """Correlated log-normal parameters: the marginal of one is log-normal."""
    rng = np.random.default_rng(7)
    prior = Prior([parameter(n, LogNormal(1.0, 2.0)) for n in "abc"])
    covariance = np.array([[1.0, 0.8, 0.1], [0.8, 1.0, 0.3], [0.1, 0.3, 1.0]]) * 0.09
    draws = np.exp(rng.multivariate_normal([0.5, 1.0, -1.0], covariance, 50000))
    part = marginal(prior.inherit(("a", "b", "c"), draws), ["c", "a"])
    assert part.names == ("a", "c")
    theta = draws[:100, [0, 2]]
    phi, kept = np.log(theta) - [0.5, -1.0], covariance[np.ix_([0, 2], [0, 2])]
    exact = -0.5 * np.einsum("ki,ij,kj->k", phi, np.linalg.inv(kept), phi)
    exact -= 0.5 * np.linalg.slogdet(2 * np.pi * kept)[1] + np.log(theta).sum(axis=1)
    assert part.log_density(theta) == pytest.approx(exact, abs=0.15)


def test_marginal_prior_of_an_ordered_group() -> None:
    rng = np.random.default_rng(8)
    times = [parameter(f"tau_{k}", LogUniform(0.1, 1e3), "s", ordered="tau") for k in (1, 2)]
    prior = Prior([parameter("a", LogNormal(2.0, 1.0)), *times])
    theta = prior.sample(rng, 50)
    rest = LogNormal(2.0, 1.0).log_density(theta[:, 0])
    found = marginal(prior, ["tau_1", "tau_2"]).log_density(theta[:, 1:])
    assert found + rest == pytest.approx(prior.log_density(theta))
    with pytest.raises(UserError, match="tau_2 shares one joint prior"):
        marginal(prior, ["a", "tau_1"])


def test_coordinate_of_parameters_of_either_sign() -> None:
    parameters = [
        parameter("mu_1", LogNormal(1e4, 1.0), half_product_with="alpha_1"),
        parameter("alpha_1", Normal(0.0, 3.0), "1"),
        parameter("x", Uniform(0.0, 1.0), "m"),
    ]
    coordinate = Coordinate.of(parameters)
    assert coordinate.logarithmic == (False, False, True)
    assert coordinate.spread_units == ("Pa", "1", "1")
    theta = np.array([[-3.0, -2.0, 0.5]])
    assert coordinate.inverse(coordinate.forward(theta)) == pytest.approx(theta)
    assert coordinate.log_derivative(theta) == pytest.approx(np.log([0.5]))
