"""Influence of parameters: Sobol' indices against closed forms, curves against simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tests.shared.contexts import PAPER, experiment
from tests.shared.membranes import golden_draws, membrane, step

from deabayes.experiment import Excitation
from deabayes.prediction import influence
from deabayes.prediction.influence import PriorModel
from deabayes.prior.distributions import LogNormal
from deabayes.prior.joint import Prior

TIME = np.r_[0.5, np.geomspace(1.0, 600.0, 12)]
NARROW = 0.01


def model(candidate="kv_gm_2", volts=2e3, **priors) -> PriorModel:
    """A step on a membrane, under the default prior or with others in their place."""
    system = membrane(candidate)
    parameters = [replace(p, prior=priors.get(p.name, p.prior)) for p in system.parameters()]
    record = experiment("step", "step", step(volts), TIME, "displacement")
    return PriorModel(system, Prior(parameters), record)


def pulled_in(limit: float) -> PriorModel:
    """equations.md 2: mu_alpha = 35 kPa at 4 kV, J_alpha `limit`, all but fixed."""
    truth = {name: float(v[0]) for name, v in golden_draws(PAPER, 1).items()} | {"J_alpha": limit}
    priors = {name: LogNormal(value, NARROW) for name, value in truth.items()}
    return model("kv_gm_1", 4e3, **priors)


def test_draws_without_an_equilibrium_are_counted_and_kept():
    rng = np.random.default_rng(1)
    lost = influence.prior_curves(pulled_in(1e9), 30, rng)
    assert lost.failed.all() and np.isnan(lost.response).all()
    assert lost.draws["mu_alpha"] == pytest.approx(np.full(30, 35e3), rel=0.05)
    assert set(pulled_in(1e9).system.why_failed(lost.draws)) == {"pull-in"}
    assert not influence.prior_curves(pulled_in(110.0), 30, rng).failed.any()


def test_a_limit_at_the_fold_loses_about_half():
    """The near equilibrium vanishes above J_alpha = 651.6; creep to it takes its time."""
    about = pulled_in(651.6)
    long = replace(about.experiment, excitation=step(4e3, 1e5), coordinate=np.array([1.0, 1e5]))
    parameters = [
        replace(p, prior=LogNormal(35e3, 1e-9)) if p.name == "mu_alpha" else p
        for p in about.prior.parameters
    ]
    drawn = influence.prior_curves(
        PriorModel(about.system, Prior(parameters), long), 400, np.random.default_rng(2)
    )
    above = drawn.draws["J_alpha"] > 651.6
    assert np.mean(drawn.failed == above) > 0.97
    assert 0.3 < drawn.failed.mean() < 0.7


def test_why_draws_are_lost():
    system = membrane("kv_gm_1")
    draws = {n: np.tile(v, 4) for n, v in golden_draws(PAPER, 1).items()}
    draws["J_alpha"] = np.array([1e9, 10.0, 60.0, 75.0])
    pull_in, below, locked, beyond = system.why_failed(draws)
    assert pull_in == "pull-in"
    assert "below the pre-stretch" in below
    assert "lock-up" in locked  # at a stretch of 5.6
    assert "breakdown" in beyond  # of 6, before the lock-up at 6.2


def test_one_at_a_time_is_direct_simulation():
    about = model()
    moved = influence.one_at_a_time(about)
    assert tuple(moved) == about.names
    medians = {name: curves.draws[name][2] for name, curves in moved.items()}
    for name in ("mu_alpha", "tau_beta_2"):
        curves = moved[name]
        for k in (0, 3):
            at = {n: np.array([v]) for n, v in medians.items()} | {name: curves.draws[name][[k]]}
            record = about.experiment
            direct = about.system.predict(record.excitation, TIME, "displacement", at)[0]
            np.testing.assert_allclose(curves.response[k], direct, rtol=1e-10)
        others = set(about.names) - {name}
        assert all(np.ptp(curves.draws[n]) == 0.0 for n in others)


def test_given_values_hold_the_others():
    moved = influence.one_at_a_time(model(), centre={"J_alpha": 123.0})
    assert set(moved["mu_alpha"].draws["J_alpha"]) == {123.0}
    assert len(set(moved["J_alpha"].draws["J_alpha"])) == len(influence.QUANTILES)


def test_quantiles_are_those_of_the_marginal_prior():
    about = model()
    found = influence.marginal_quantiles(about)
    exact = LogNormal(25e3, 0.8).from_normal(np.array([-1.6448536, -0.6744898, 0, 0.6744898,
                                                       1.6448536]))  # fmt: skip
    np.testing.assert_allclose(found["mu_alpha"], exact, rtol=2e-3)
    drawn = about.prior.sample(np.random.default_rng(0), 20000)
    column = drawn[:, about.prior.names.index("tau_beta_2")]
    np.testing.assert_allclose(
        np.log(found["tau_beta_2"]), np.log(np.quantile(column, influence.QUANTILES)), atol=0.15
    )


def test_stages_are_decades_after_the_onset():
    about = model()
    late = Excitation("voltage", "V", np.array([0.0, 7.0, 7.1, 607.0]), np.array([0, 10, 4e3, 4e3]))
    record = replace(about.experiment, excitation=late, coordinate=TIME + 7.0)
    assert late.onset == 7.0
    np.testing.assert_allclose(influence.stage_times(record), [0.5, 5.0, 50.0, 500.0])
    short = replace(about.experiment, coordinate=np.array([0.0, 0.05]))
    np.testing.assert_allclose(influence.stage_times(short, 2), [0.005, 0.05])


def test_changes_by_stage_are_direct_simulation():
    about = model()
    z = np.random.default_rng(4).standard_normal((5, len(about.names)))
    times = np.array([5.0, 50.0])
    found = influence.stage_changes(about, z, times)
    record = about.experiment
    direct = about.system.predict(record.excitation, times, "displacement", about.parameters(z))
    np.testing.assert_allclose(found["at 50 s"], direct[:, 1], rtol=1e-5)
    np.testing.assert_allclose(found["5 to 50 s"], direct[:, 1] - direct[:, 0], rtol=1e-4)


def test_sensitivity_takes_the_widest_region_that_hardly_fails():
    rng = np.random.default_rng(5)
    stages = partial(influence.stage_changes, times=np.array([0.5, 50.0]))
    weak, strong = (
        influence.stage_sensitivity(model(volts=v), stages, 128, rng) for v in (1e3, 4e3)
    )
    assert weak.region == influence.REGIONS[0] and weak.failed == 0
    assert strong.region < weak.region
    first = weak.by_stage["at 0.5 s"].first_order
    assert model().names[int(np.argmax(first))] == "zeta_alpha"
    assert model().names[int(np.argmax(weak.by_stage["at 50 s"].first_order))] == "mu_alpha"
    lost = influence.failure_sensitivity(model(volts=4e3), 128, rng)
    assert 0.05 < lost.failed / lost.runs < 0.3
    totals = dict(zip(model().names, lost.by_stage["lost"].total, strict=True))
    assert set(sorted(totals, key=totals.__getitem__)[-2:]) == {"mu_alpha", "J_alpha"}


def test_parameters_of_the_noise_are_left_alone():
    about = model()
    noise = replace(about.prior.parameters[0], name="step.sigma_white")
    with_noise = replace(about, prior=Prior([noise, *about.prior.parameters]))
    assert with_noise.names == about.names
    z = np.random.default_rng(6).standard_normal((4, len(about.names)))
    np.testing.assert_array_equal(
        with_noise.response(with_noise.parameters(z)), about.response(about.parameters(z))
    )


def test_of_a_prior_handed_on_it_is_that_prior_not_the_normal_of_its_moments():
    """mu_alpha about 20 or 80 kPa, nothing between: no draw and no quantile is between."""
    plain = model("kv_gm_1")
    rng = np.random.default_rng(3)
    kilopascal = np.where(rng.random(4000) < 0.3, 20.0, 80.0) * np.exp(
        0.03 * rng.standard_normal(4000)
    )
    handed_on = replace(plain, prior=plain.prior.inherit(["mu_alpha"], 1e3 * kilopascal[:, None]))
    assert plain.prior.is_normal_in_z and not handed_on.prior.is_normal_in_z
    drawn = influence.prior_curves(handed_on, 300, rng).draws["mu_alpha"]
    quantiles = influence.marginal_quantiles(handed_on, [0.2, 0.25, 0.5, 0.9])["mu_alpha"]
    assert not np.any((drawn > 25e3) & (drawn < 65e3))
    assert np.mean(drawn < 50e3) == pytest.approx(0.3, abs=0.08)
    np.testing.assert_allclose(quantiles, [20.4e3, 20.9e3, 79.1e3, 82.6e3], rtol=0.02)


GROUPS = 4096


def generator():
    return np.random.default_rng(3)


def ishigami(u, a=7.0, b=0.1):
    """sin x1 + a sin^2 x2 + b x3^4 sin x1, x uniform on [-pi, pi] (Ishigami & Homma 1990)."""
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_indices(a=7.0, b=0.1):
    one = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2
    two = a * a / 8.0
    both = 8.0 * b * b * np.pi**8 / 225.0
    total = one + two + both
    return np.array([one, two, 0.0]) / total, np.array([one + both, two, both]) / total


def within(found, conf, exact):
    """A 95 % half-width is two standard errors: four of them, and rounding."""
    np.testing.assert_array_less(np.abs(found - exact), 2.0 * conf + 1e-9)


def test_ishigami():
    points = influence.design(3, GROUPS, generator())
    assert points.shape == (GROUPS * 5, 3)
    found = influence.indices(ishigami(points), 3, generator())
    first, total = ishigami_indices()
    within(found.first_order, found.first_order_conf, first)
    within(found.total, found.total_conf, total)
    np.testing.assert_allclose(found.first_order, first, atol=0.01)
    np.testing.assert_allclose(found.total, total, atol=0.01)
    assert np.all(found.total_conf < 0.05)
    assert (found.groups, found.left_out) == (GROUPS, 0)


def test_an_additive_function_has_equal_first_and_total_indices():
    from scipy.special import ndtri

    weights = np.array([1.0, 2.0, 0.0, 3.0])
    points = influence.design(4, GROUPS, generator())
    found = influence.indices(5.0 + ndtri(points) @ weights, 4, generator())
    exact = weights**2 / np.sum(weights**2)
    np.testing.assert_allclose(found.first_order, exact, atol=0.01)
    np.testing.assert_allclose(found.total, exact, atol=0.01)
    assert found.first_order[2] == found.total[2] == 0.0


def test_intervals_cover_the_truth():
    """Of 95 % intervals of random repeats, at least 80 % cover: they err on the wide side."""
    first, _ = ishigami_indices()
    covered = []
    for seed in range(40):
        own = np.random.default_rng(seed)
        points = influence.design(3, 256, own)
        found = influence.indices(ishigami(points), 3, own)
        covered.append(np.abs(found.first_order - first) <= found.first_order_conf)
    assert np.mean(covered, axis=0)[:2].min() >= 0.8


def test_a_failed_point_takes_its_group_with_it():
    points = influence.design(3, GROUPS, generator())
    values = ishigami(points)
    values[[0, 1, 7]] = np.nan
    found = influence.indices(values, 3, generator())
    assert found.left_out == 2
    kept = influence.indices(values[10:], 3, generator())
    np.testing.assert_array_equal(found.first_order, kept.first_order)


@pytest.mark.parametrize("values", [np.ones(50), np.full(50, np.nan)])
def test_nothing_to_explain(values):
    assert influence.indices(values, 3, generator()) is None
