"""Membrane: pull-in, equilibria, and draws that leave the model's range."""

from __future__ import annotations

import time as clock

import numpy as np
import pytest
from tests.shared.golden import golden_table, load_golden
from tests.shared.membranes import (
    golden_draws,
    membrane,
    prior_draws,
    rows,
    sine,
    specimen,
    step,
    voltage,
)

from deabayes.experiment import Quantity
from deabayes.systems.membrane.system import Membrane, follow

CASES = (
    "A_no_stretch_limit_n1",
    "A_no_stretch_limit_n2",
    "A_no_stretch_limit_n3",
    "B_limit_on_Maxwell_springs_only_n3",
    "C_Jalpha_1000_n3",
    "D_Jalpha_400_n3",
)


def case_draws(case):
    inputs = load_golden("membrane_pull_in")["inputs"]
    settings = inputs["cases"][case]
    limits = {"J_alpha": settings["J_alpha"], "J_beta": settings["J_beta"]}
    return settings, golden_draws(inputs, settings["n"], **limits)


@pytest.mark.parametrize("case", CASES)
def test_golden_times_of_pull_in(case):
    settings, draws = case_draws(case)
    table = golden_table("membrane_pull_in", case)
    far = specimen(breakdown_stretch=Quantity(2000.0, "1"))
    system = Membrane(f"kv_gm_{settings['n']}", far, 1e-10)
    material = system._material(draws)
    for level, reached in zip(*table.values(), strict=True):
        if np.isnan(reached):
            continue
        around = reached + np.array([-1e-5, 1e-5])
        history = system._history(step(4e3, 2000.0), around)
        before, after = follow(material, history, around, 1e-10, np.full(1, 2000.0)).values[0]
        assert before < level < after


@pytest.mark.parametrize("case", CASES)
def test_draws_are_lost_at_pull_in(case):
    settings, draws = case_draws(case)
    system = membrane(f"kv_gm_{settings['n']}")
    found = system.predict(step(4e3, 2000.0), np.array([0.0, 1.0, 2000.0]), "stretch", draws)
    ended, volts = system.lost(step(4e3, 2000.0), 2000.0, draws)
    pull_in = system.pull_in(draws)
    assert pull_in.fold[0]
    if case.startswith("D"):
        assert np.all(np.isfinite(found))
        assert np.isnan(ended[0])
        near = min(settings["equilibria"])
        assert system.steady_stretch(draws, 4e3)[0] == pytest.approx(near, abs=1e-7)
        return
    assert np.all(np.isnan(found))
    assert np.isnan(system.steady_stretch(draws, 4e3)[0])
    assert volts[0] == 4e3
    table = golden_table("membrane_pull_in", case)
    levels, reached = table["stretch_level"], table["first_time_reached"]
    passed = np.interp(pull_in.stretch[0], levels[:4], reached[:4])
    assert ended[0] == pytest.approx(passed, rel=0.25)


def test_critical_voltages():
    inputs = load_golden("membrane_pull_in")["inputs"]
    draws = golden_draws(inputs, 1, J_alpha=None, J_beta=55.0)
    critical = inputs["critical_voltage_V_without_limit"]
    assert membrane("kv_gm_1").pull_in(draws).voltage[0] == pytest.approx(critical, rel=1e-9)
    draws["J_alpha"][:] = inputs["fold_J_alpha_at_4kV"]
    found = membrane("kv_gm_1").pull_in(draws)
    assert found.voltage[0] == pytest.approx(4000.0, rel=1e-8)
    assert found.fold[0]


def test_equilibria_of_the_step_table():
    inputs = load_golden("membrane_step")["inputs"]
    draws = golden_draws(inputs, 3)
    for label, expected in inputs["equilibrium_stretch"].items():
        found = membrane().steady_stretch(draws, 1e3 * float(label.split()[0]))
        assert found[0] == pytest.approx(expected, abs=1e-11)
    assert not membrane().pull_in(draws).fold[0]


def test_steady_stretch_ends_a_long_record_on_the_near_branch():
    system = membrane("kv_gm_2")
    draws = prior_draws(system, 200)
    for volts in (2e3, 4e3):
        end = system.predict(step(volts, 1e6), np.array([1e6]), "stretch", draws)[:, 0]
        expected = system.steady_stretch(draws, volts)
        np.testing.assert_array_equal(np.isnan(end), np.isnan(expected))
        np.testing.assert_allclose(end, expected, atol=1e-5)
    assert 10 < np.isnan(expected).sum() < 100


def test_a_ramp_pulls_in_at_a_higher_voltage_than_a_steady_one():
    system = membrane("kv_gm_1")
    _, draws = case_draws("A_no_stretch_limit_n1")
    steady = system.pull_in(draws).voltage[0]
    slow, fast = (
        system.lost(voltage([0.0, last], [0.0, 6e3]), last, draws)[1][0] for last in (1e5, 60.0)
    )
    assert slow == pytest.approx(steady, rel=0.05)
    assert steady < slow < fast < 6e3


def test_the_breakdown_stretch_bounds_draws_without_a_fold():
    inputs = load_golden("membrane_step")["inputs"]
    draws = golden_draws(inputs, 3)
    weak = Membrane("kv_gm_3", specimen(breakdown_stretch=Quantity(3.3, "1")))
    time = np.linspace(0.0, 600.0, 20)
    assert np.all(np.isnan(weak.predict(step(4e3), time, "stretch", draws)))
    assert np.all(np.isfinite(weak.predict(step(3e3), time, "stretch", draws)))
    found = weak.pull_in(draws)
    assert found.stretch[0] == 3.3
    assert weak.steady_stretch(draws, found.voltage[0] * 0.999999)[0] < 3.3


@pytest.mark.parametrize(
    ("limit", "why"),
    [(15.1, "at the Gent spring's lock-up"), (14.0, "Gent limit below the pre-stretch")],
)
def test_a_spring_about_to_lock_up_is_named(limit: float, why: str) -> None:
    draws = golden_draws(load_golden("membrane_step")["inputs"], 3) | {"J_alpha": np.array([limit])}
    note = membrane().failure_note(step(4e3), np.array([0.0, 600.0]), draws)
    assert note.startswith(why)


def test_lost_draws_cost_little_and_change_no_other():
    system = membrane()
    draws = prior_draws(system, 64)
    draws["J_alpha"][::4] = 15.1  # lock-up at the pre-stretch itself, nearly
    draws["J_alpha"][1::4] = 10.0  # lock-up below it
    draws["zeta_alpha"][2::8] = 1e-12
    draws["mu_alpha"][5] = 1e-9
    draws["tau_beta_1"][6] = 1e-14
    start = clock.perf_counter()
    for driven in (step(4e3), sine(0.05)):
        found = system.predict(driven, np.linspace(0.0, 100.0, 20), "stretch", draws)
        assert np.all(np.isnan(found[1::4]))
        assert np.isnan(found[5, 0])
        for w in (3, 7, 11, 15):
            alone = system.predict(
                driven, np.linspace(0.0, 100.0, 20), "stretch", rows(draws, slice(w, w + 1))
            )
            np.testing.assert_array_equal(alone[0], found[w])
    assert clock.perf_counter() - start < 20.0


FAR_OUT = {
    "mu_alpha": 1.058e4, "zeta_alpha": 8.281e4, "J_alpha": 19.04, "J_beta": 13.06,
    "mu_beta_1": 2080.0, "mu_beta_2": 11.77, "mu_beta_3": 1.101e24,
    "tau_beta_1": 1.002, "tau_beta_2": 2.407, "tau_beta_3": 4.815,
}  # fmt: skip
"""A draw of the sampler 56 prior sds out."""


def test_a_draw_whose_steps_stay_tiny_is_given_up():
    """Steps may be good and yet never arrive; here a tolerance asks for too many of them."""
    draws = {n: np.full(2, value) for n, value in FAR_OUT.items()} | {
        "mu_beta_3": np.full(2, 1.5e4)
    }
    draws["zeta_alpha"][1] = 1e12
    driven = sine(1.0, periods=100, per_period=100)
    found = membrane("kv_gm_3", 1e-12).predict(driven, np.array([1.0, 100.0]), "stretch", draws)
    assert np.isnan(found).all(axis=1).tolist() == [True, False]


def test_a_draw_that_cannot_move_is_not_given_up():
    """Its spring is as good as rigid; once it took for ever."""
    draws = {name: np.array([value]) for name, value in FAR_OUT.items()}
    found = membrane("kv_gm_3").predict(step(4e3), np.array([1.0, 600.0]), "stretch", draws)
    np.testing.assert_allclose(found, 3.0, rtol=0.0, atol=1e-12)
