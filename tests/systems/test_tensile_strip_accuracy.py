"""The strip's default accuracy: against scipy, over the prior, of noisy and of short records."""

from __future__ import annotations

import numpy as np
import pytest
from tests.systems.test_tensile_strip import (
    HISTORIES,
    excitation,
    prior_draws,
    relaxation,
    rows,
    some_draws,
    strip,
)

from deabayes.experiment import Excitation, Specimen
from deabayes.systems.tensile_strip.system import TensileStrip


def scipy_unit_stress(history, time, tau, inverse_limit):
    """P/mu of one Maxwell unit by an independent solver, restarted at every knot."""
    from scipy.integrate import solve_ivp

    knots, values = (np.array(part, float) for part in history)

    def law(stretch, xi):
        invariant = stretch**2 / xi**2 + 2 * xi / stretch - 3
        return 1 - invariant * inverse_limit

    stress, xi = np.zeros_like(time), values[0]
    for k in range(knots.size - 1):
        rate = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])

        def flow(t, y, k=k, rate=rate):
            lam = values[k] + rate * (t - knots[k])
            return (lam**2 / y**3 - 1 / lam) / law(lam, y) / tau

        inside = (time >= knots[k]) & (time <= knots[k + 1])
        asked = np.unique(np.append(time[inside], knots[k + 1]))
        solution = solve_ivp(flow, knots[k : k + 2], [xi], "LSODA", asked, rtol=1e-11, atol=1e-13)
        lam = values[k] + rate * (time[inside] - knots[k])
        found = solution.y[0, np.searchsorted(asked, time[inside])]
        stress[inside] = (lam / found**2 - found / lam**2) / law(lam, found)
        xi = solution.y[0, -1]
    return stress


def scipy_response(model, history, time, draws, walker):
    knots, values = history
    single = rows(draws, [walker])
    lam = np.interp(time, knots, values)
    total = model.spring.nominal_stress(lam, model.spring_draws(single))[0]
    if model.kelvin:
        segment = np.searchsorted(knots, time, side="right") - 1
        slopes = np.diff(values) / np.diff(knots)
        total = total + single["zeta_alpha"] * slopes[np.clip(segment, 0, slopes.size - 1)]
    for modulus, tau in zip(*(values[0] for values in model.unit_draws(single)), strict=True):
        limit = 1.0 / single["J_beta"][0] if model.kelvin else 0.0
        total = total + modulus * scipy_unit_stress(history, time, tau, limit)
    return total


@pytest.mark.parametrize(
    ("candidate", "case", "seed"),
    [("kv_gm_1", "strip_relaxation", 1), ("kv_gm_2", "strip_triangle", 2),
     ("ogden_2_units_2", "strip_triangle", 3)],
)  # fmt: skip
def test_default_accuracy_against_scipy(candidate, case, seed):
    system, history = strip(candidate), HISTORIES[case]
    draws = prior_draws(system, 12, seed)
    time = np.linspace(0.0, 80.0, 33)
    found = system.predict(excitation(*history), time, "nominal_stress", draws)
    for walker in range(12):
        expected = scipy_response(system.model, history, time, draws, walker)
        assert np.max(np.abs(found[walker] - expected)) < 1e-6 * np.ptp(expected)


@pytest.mark.parametrize("candidate", ["kv_gm_1", "kv_gm_3", "neo_hookean_units_3"])
@pytest.mark.parametrize("record", ["relaxation", "triangle", "sine", "far", "noisy"])
def test_default_accuracy_over_the_prior(candidate, record):
    time = np.linspace(0.0, 80.0, 161)
    noisy = 2.0 + 3e-6 * np.random.default_rng(4).standard_normal(49)
    knots = np.r_[0.0, 2.0, np.arange(20.0, 1000.0, 20.0)]
    histories = {
        "noisy": (excitation(knots, np.r_[1.0, 2.0, noisy]), np.linspace(0.0, 980.0, 981)),
        "relaxation": relaxation(3.5),
        "triangle": (excitation(*HISTORIES["strip_triangle"]), time),
        "sine": (excitation(time, 1.5 - 0.5 * np.cos(0.2 * np.pi * time)), time),
        "far": (excitation([0.0, 100.0], [1.0, 6.0]), time),
    }
    system, reference = strip(candidate), strip(candidate, 1e-11)
    draws = prior_draws(system, 200, 11)
    found, expected = (s.predict(*histories[record], "nominal_stress", draws)
                       for s in (system, reference))  # fmt: skip
    if record == "far" and system.model.kelvin:
        top = 1.0 + 0.05 * time[-1]
        passed = top**2 + 2 / top - 3 < draws["J_alpha"]
    else:
        passed = np.full(200, True)
    np.testing.assert_array_equal(np.all(np.isfinite(found), axis=1), passed)
    error = np.max(np.abs(found - expected)[passed], axis=1) / np.ptp(expected[passed], axis=1)
    assert np.max(error) < 1e-6


def test_a_unit_near_its_gent_limit_is_resolved():
    draws = some_draws(1, J_beta=3.0, tau_beta_1=500.0, zeta_alpha=0.0)
    history = ([0.0, 10.0, 60.0], [1.0, 4.0, 4.0])
    time = np.linspace(0.0, 60.0, 25)
    found = strip("kv_gm_1").predict(excitation(*history), time, "nominal_stress", draws)[0]
    expected = scipy_response(strip("kv_gm_1").model, history, time, draws, 0)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.ptp(expected))


def test_kinks_of_a_noisy_stretch_cost_far_less_than_the_noise_itself():
    noise = 1e-3
    time = np.linspace(0.0, 980.0, 981)
    knots = np.r_[0.0, 2.0, np.arange(20.0, 1000.0, 20.0)]
    wiggle = noise * np.random.default_rng(4).standard_normal(49)
    record = excitation(knots, np.r_[1.0, 2.0, 2.0 + wiggle]), time
    draws = prior_draws(strip("kv_gm_3"), 200, 12)
    found, expected = (
        strip("kv_gm_3", tolerance).predict(*record, "nominal_stress", draws)
        for tolerance in (1e-6, 1e-11)
    )
    error = np.max(np.abs(found - expected), axis=1) / np.ptp(expected, axis=1)
    assert np.max(error) < 0.02 * noise


@pytest.mark.parametrize("candidate", ["kv_gm_1", "neo_hookean_units_1"])
def test_what_is_left_at_stretch_one_is_as_accurate_as_elsewhere(candidate):
    """The spring bears nothing there, and so no error of the unit was refused."""
    times = np.geomspace(1e-3, 0.1, 30)
    group = "tau_beta_1" if candidate == "kv_gm_1" else "tau_1"
    draws = {"mu": 3e4, "mu_alpha": 3e4, "zeta_alpha": 1e4, "J_alpha": 100.0, "J_beta": 100.0}
    draws = {name: np.full(30, value) for name, value in draws.items()}
    draws |= {"mu_beta_1": np.full(30, 3e4), group: times}
    bare = Specimen("strip", "tensile_strip", {}, {})
    unloaded = Excitation("stretch", "1", np.array([0.0, 0.2, 0.4, 30.0]), np.array([1, 3, 1, 1.0]))
    after = np.array([0.41, 0.42, 0.45])
    found = TensileStrip(candidate, bare).predict(unloaded, after, "nominal_stress", draws)
    whole = TensileStrip(candidate, bare, 1e-9).predict(
        unloaded, np.append(0.1, after), "nominal_stress", draws
    )
    error = np.max(np.abs(found - whole[:, 1:]), axis=1)
    assert np.max(error) < 1e-8 * np.max(np.abs(whole))
