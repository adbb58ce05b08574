"""Dry friction of the minimum-energy structure: against scipy, and in the limits of its law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.structures import paper_draws, sine, structure, voltage

from deabayes.systems.minimum_energy_structure.kernel import DRY_SPEED

LENGTH, REST = 0.067, np.pi / 4
FRICTION = (7e-3, 0.05, 0.126, 0.25)
"""[N]: hardly felt, sticking where it turns, sticking most of the time, creeping only; the
blocking force at 5 kV is 0.15 N."""


def _dry(force, **changes):
    return paper_draws(1, np.size(force)) | {"friction_force": np.ravel(force)} | changes


def _expected(force, frequency, times):
    """Displacement of the paper's film, one unit, by the equation as it is written."""
    draws = paper_draws(1)
    held = structure("ogden_4_units_1_dry").structure(_dry(force))
    section, weight, hinge = held.section[0], held.weight[0], held.hinge[0]
    electric, inertia, turning = held.electric[0], held.inertia[0], held.turning[0]
    film = [(draws[f"mu_{i}"][0], draws[f"alpha_{i}"][0]) for i in range(1, 5)]
    k, tau = draws["k_1"][0], draws["tau_1"][0]

    def slope(time, state):
        angle, omega, x = state.tolist()
        s, c = math.sin(angle), math.cos(angle)
        volts = 2750.0 - 2250.0 * math.cos(2.0 * math.pi * frequency * time)
        v = LENGTH * s * omega
        moment = section * sum(m * ((5 * c) ** a - (25 * c) ** -a) for m, a in film) * s / c
        moment += LENGTH * s * (k * x - force * v / math.hypot(v, DRY_SPEED)) - weight * c
        moment -= hinge * angle + s * c * (electric * volts**2 + turning * omega**2)
        return [omega, moment / (inertia + turning * s * s), -v - x / tau]

    found = solve_ivp(
        slope, (0.0, times[-1]), [REST, 0.0, 0.0], "LSODA", times, rtol=1e-10, atol=1e-13
    )
    return LENGTH * (np.cos(found.y[0]) - np.cos(REST))


def test_tolerance_holds_where_friction_holds_the_slider():
    """Once up to 5000 times the tolerance, a step that jumped the turn being none the wiser."""
    times = np.linspace(0.0, 0.1, 51)
    expected = np.array([_expected(force, 10.0, times) for force in FRICTION])
    for tolerance in (1e-4, 1e-5, 1e-6):
        system = structure("ogden_4_units_1_dry", tolerance)
        driven = sine(10.0, 1, per_period=2000)
        found = system.predict(driven, times, "displacement", _dry(FRICTION))
        error = np.max(np.abs(found - expected), axis=1) / np.ptp(expected, axis=1)
        assert np.max(error) < 5.0 * tolerance


def test_without_friction_both_kinds_are_none():
    times, driven = np.linspace(0.0, 0.4, 81), sine(5.0, 2, 3.0)
    found = [
        structure(name, 1e-9).predict(driven, times, "displacement", draws)[0]
        for name, draws in (
            ("ogden_4_units_1", paper_draws(1, eta_0=1e-30)),
            ("ogden_4_units_1_dry", _dry(1e-30)),
        )
    ]
    assert np.ptp(found[0]) > 1e-3
    assert found[0] == pytest.approx(found[1], abs=1e-8 * np.ptp(found[0]))


def test_much_friction_lets_nothing_move():
    times, driven = np.linspace(0.0, 1.0, 41), sine(5.0, 5)
    found = structure("ogden_4_units_1_dry").predict(driven, times, "displacement", _dry(1e4))[0]
    assert np.max(np.abs(found)) < 1e-8


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_what_holds_creeps_as_slowly_as_the_smoothing_says(share):
    """Force on the slider share F_c: v = v_s share/sqrt(1 - share^2), as long as that lasts."""
    system = structure("ogden_4_units_1_dry")
    held = system.structure(_dry(0.1, k_1=np.array([1e-9])))
    push = -held.moment(held.rest[:, np.newaxis], 5e3)[0, 0] / (LENGTH * np.sin(REST))
    draws, times = _dry(push / share, k_1=np.array([1e-9])), np.linspace(0.0, 1e-2, 21)
    found = system.predict(voltage([0.0, 1.0], [5e3, 5e3]), times, "displacement", draws)[0]
    creep = np.polyfit(times, found, 2)[1]
    assert creep == pytest.approx(DRY_SPEED * share / np.sqrt(1.0 - share**2), rel=0.02)
