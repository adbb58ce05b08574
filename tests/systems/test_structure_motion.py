"""Minimum-energy structure in motion: golden tables, accuracy, independence of draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from tests.shared.golden import golden_table
from tests.shared.structures import (
    LENGTH,
    REST,
    paper_draws,
    sine,
    specimen,
    spread_draws,
    structure,
    voltage,
)

from deabayes.experiment import Quantity
from deabayes.faults import UserError
from deabayes.systems.minimum_energy_structure.kernel import DRY_SPEED


@pytest.mark.parametrize("kilovolt", [4, 5])
@pytest.mark.parametrize("frequency", [1, 5, 10])
def test_golden_periods(kilovolt, frequency):
    for period in ("first", "tenth"):
        table = golden_table("mes_dynamic", f"{kilovolt}kV_{frequency}Hz_{period}_period")
        expected = np.array(table["displacement"])
        for tolerance, allowed in ((1e-9, 1e-10), (1e-6, 1e-6 * np.ptp(expected))):
            system = structure(tolerance=tolerance)
            driven = sine(frequency, amplitude=kilovolt, per_period=2000)
            found = system.predict(driven, table["time"], "displacement", paper_draws())[0]
            assert np.max(np.abs(found - expected)) < allowed


@pytest.mark.parametrize("units", [1, 4])
@pytest.mark.parametrize("frequency", [1.0, 10.0])
def test_tolerance_holds_for_plausible_draws(units, frequency):
    draws, driven = spread_draws(units), sine(frequency, per_period=200)
    times = np.linspace(0.0, 10.0 / frequency, 400)
    fine = structure(f"ogden_4_units_{units}", 1e-9).predict(driven, times, "displacement", draws)
    usual = structure(f"ogden_4_units_{units}").predict(driven, times, "displacement", draws)
    error = np.max(np.abs(usual - fine), axis=1) / np.ptp(fine, axis=1)
    assert np.max(error) < 1e-6


@pytest.mark.parametrize(
    ("driven", "last"), [(voltage([0.0, 2.0], [3e3, 3e3]), 2.0), (sine(1.0, 2, 3.0, 200), 2.0)]
)
@pytest.mark.parametrize("dry", [False, True])
def test_tolerance_holds_where_it_rings(driven, last, dry):
    """Errors of the periods that are remembered add up, once to 300 times the tolerance."""
    draws = spread_draws(1, 16) | {"k_1": np.full(16, 0.5)}
    friction = np.geomspace(1e-5, 1e-3, 16) if dry else np.geomspace(1e-3, 0.3, 16)
    draws["friction_force" if dry else "eta_0"] = friction
    name = "ogden_4_units_1_dry" if dry else "ogden_4_units_1"
    times = np.linspace(0.0, last, 400)
    fine, usual = (
        structure(name, tolerance).predict(driven, times, "displacement", draws)
        for tolerance in (1e-9, 1e-6)
    )
    error = np.max(np.abs(usual - fine), axis=1) / np.ptp(fine, axis=1)
    assert np.median(error) < 2e-6
    assert np.max(error) < 3e-6


@pytest.mark.parametrize("dry", [False, True])
def test_against_scipy_with_either_friction(dry):
    name = "friction_force" if dry else "eta_0"
    draws = paper_draws(1, **{name: 2e-3 if dry else 0.1})
    system = structure("ogden_4_units_1_dry" if dry else "ogden_4_units_1", 1e-8)
    held, driven = system.structure(draws), sine(5.0, 2)
    k, tau, friction = draws["k_1"][0], draws["tau_1"][0], draws[name][0]
    volts = CubicSpline(driven.coordinate, driven.values)

    def slope(time, state):
        angle, omega, x = state
        v = LENGTH * np.sin(angle) * omega
        resist = friction * (v / np.hypot(v, DRY_SPEED) if dry else v)
        moment = held.moment(np.array([angle]), float(volts(time)))[0, 0]
        moment += LENGTH * np.sin(angle) * (k * x - resist)
        moment -= held.turning[0] * np.sin(angle) * np.cos(angle) * omega**2
        return [omega, moment / held.mass(angle)[0], -v - x / tau]

    times = np.linspace(0.0, 0.4, 81)
    expected = solve_ivp(
        slope, (0.0, 0.4), [REST, 0.0, 0.0], "Radau", times, rtol=1e-9, atol=1e-12, max_step=2e-3
    ).y[0]
    found = system.predict(driven, times, "displacement", draws)[0]
    moved = LENGTH * (np.cos(expected) - np.cos(REST))
    assert np.max(np.abs(found - moved)) < 2e-6 * np.ptp(moved)


def test_a_gent_film_near_its_limit():
    """I_1 - 3 is 34.5 at rest and 47 when flat: a polynomial of the stress missed the pole.

    The fourth draw's response was 8 times its range away, those before it failed.
    """
    limit = np.array([36.0, 40.0, 46.0, 47.5, 55.0])
    others = {"mu": 2e4, "relative_permittivity": 4.0, "k_1": 5.0, "tau_1": 0.5, "eta_0": 0.1}
    draws = {"J": limit, **{name: np.full(5, value) for name, value in others.items()}}
    system = structure("gent_units_1", 1e-8)
    held, times = system.structure(draws), np.linspace(0.0, 2.0, 41)
    found = system.predict(voltage([0.0, 2.0], [3e3, 3e3]), times, "displacement", draws)
    for w in range(5):

        def slope(time, state, w=w):
            angle, omega, x = state
            v = LENGTH * np.sin(angle) * omega
            moment = held.moment(np.array([angle]), 3e3)[w, 0]
            moment += LENGTH * np.sin(angle) * (5.0 * x - 0.1 * v)
            moment -= held.turning[w] * np.sin(angle) * np.cos(angle) * omega**2
            return [omega, moment / held.mass(angle)[w], -v - x / 0.5]

        expected = solve_ivp(
            slope, (0.0, 2.0), [REST, 0.0, 0.0], "DOP853", times, rtol=1e-10, atol=1e-13
        ).y[0]
        moved = LENGTH * (np.cos(expected) - np.cos(REST))
        assert np.max(np.abs(found[w] - moved)) < 1e-6 * np.ptp(moved)


def test_the_paper_s_friction_of_a_coulomb_coefficient_would_be_another_model():
    driven, times = sine(10.0, 3), np.linspace(0.0, 0.3, 100)
    viscous = structure("ogden_4_units_1").predict(driven, times, "displacement", paper_draws(1))
    dry = structure("ogden_4_units_1_dry").predict(
        driven, times, "displacement", paper_draws(1, friction_force=0.1)
    )
    assert np.max(np.abs(viscous - dry)) > 0.1 * np.ptp(viscous)


def test_a_draw_does_not_depend_on_its_lane_mates():
    driven, times = sine(5.0, 2, per_period=200), np.linspace(0.0, 0.4, 50)
    draws = spread_draws(2, 70)
    draws["mu_2"][3] = np.nan
    draws["relative_permittivity"][5] *= 20.0
    system = structure("ogden_4_units_2")
    together = system.predict(driven, times, "displacement", draws)
    assert np.all(np.isnan(together[[3, 5]]))
    assert np.isnan(together[:, 0]).sum() == 2
    for k in (0, 4, 6, 40, 69):
        alone = {name: values[k : k + 1] for name, values in draws.items()}
        assert np.array_equal(system.predict(driven, times, "displacement", alone)[0], together[k])
    words = system.why_failed(draws)
    assert "push" in words[3]
    assert "bent branch" in words[5]


def test_outputs_may_come_in_any_order():
    driven, times = sine(5.0, 2, per_period=200), np.linspace(0.0, 0.4, 50)
    mixed = np.random.default_rng(0).permutation(times)
    system, draws = structure("ogden_4_units_2"), paper_draws(2)
    sorted_, shuffled = (
        system.predict(driven, t, "displacement", draws)[0] for t in (times, mixed)
    )
    assert np.array_equal(shuffled[np.argsort(mixed)], sorted_)


def test_uncertain_geometry_moves_the_response():
    uncertain = specimen(rest_angle=Quantity(REST, "rad", 0.01))
    system = structure("ogden_4_units_1", specimen=uncertain)
    assert "rest_angle" in {p.name for p in system.parameters()}
    draws = paper_draws(1, 2) | {"rest_angle": np.array([REST, REST + 0.02])}
    found = system.predict(sine(5.0, 1), np.linspace(0.0, 0.2, 30), "displacement", draws)
    exact = structure("ogden_4_units_1").predict(
        sine(5.0, 1), np.linspace(0.0, 0.2, 30), "displacement", paper_draws(1)
    )
    assert np.array_equal(found[0], exact[0]), "the other draw's rest angle is in it"
    assert np.max(np.abs(found[1] - found[0])) > 1e-5


def test_times_must_ascend():
    with pytest.raises(UserError, match="ascend"):
        structure().simulator(voltage([0.0, 2.0, 1.0], [1, 2, 3]), [0.5], "displacement")
