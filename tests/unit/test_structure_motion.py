"""Minimum-energy structure in motion: golden tables, energy, limits, independence of draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from tests.unit.golden import golden_table
from tests.unit.structures import (
    paper_draws,
    sine,
    specimen,
    spread_draws,
    structure,
    voltage,
)

from deabayes.experiment import Quantity
from deabayes.faults import UserError
from deabayes.systems.structure_kernel import DRY_SPEED

LENGTH, REST = 0.067, np.pi / 4


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


def _motion(system, draws, driven, times):
    """theta, omega and the rate of the slider at evenly spaced times, for one draw."""
    moved = system.predict(driven, times, "displacement", draws)[0]
    angle = CubicSpline(times, np.arccos(np.cos(REST) + moved / LENGTH))
    return angle(times), angle(times, 1), -LENGTH * np.sin(angle(times)) * angle(times, 1)


def _unit(rate, time, tau):
    """x' = rate - x/tau from rest, by the exact solution for a linear rate."""
    step = time[1] - time[0]
    decay, x = np.exp(-step / tau), np.zeros_like(rate)
    late = tau * (1.0 - tau / step * (1.0 - decay))
    early = tau * (1.0 - decay) - late
    for k in range(1, rate.size):
        x[k] = decay * x[k - 1] + early * rate[k - 1] + late * rate[k]
    return x


@pytest.mark.parametrize(("dry", "friction"), [(False, 0.1), (True, 5e-3)])
def test_energy_balance(dry, friction):
    system = structure("ogden_4_units_4_dry" if dry else "ogden_4_units_4", 1e-9)
    draws = paper_draws(**{"friction_force" if dry else "eta_0": friction})
    driven = sine(5.0, 2, per_period=4000)
    times = np.linspace(0.0, 0.4, 20001)
    angle, omega, rate = _motion(system, draws, driven, times)
    held = system.structure(draws)
    volts = CubicSpline(driven.coordinate, driven.values)(times)

    def work(power):
        return CubicSpline(times, power).antiderivative()(times)

    electric = work(-held.electric[0] * np.sin(angle) * np.cos(angle) * volts**2 * omega)
    stored = -work(held.moment(angle)[0] * omega)
    kinetic = 0.5 * held.mass(angle) * omega**2
    lost = work(friction * rate**2 / (np.hypot(rate, DRY_SPEED) if dry else 1.0))
    for i in range(1, 5):
        k, tau = draws[f"k_{i}"][0], draws[f"tau_{i}"][0]
        x = _unit(rate, times, tau)
        stored = stored + 0.5 * k * x**2
        lost = lost + work(k / tau * x**2)
    imbalance = electric - stored - kinetic - lost
    assert np.max(np.abs(imbalance)) < 1e-6 * np.ptp(electric)
    assert lost[-1] > 0.1 * np.ptp(electric)


@pytest.mark.parametrize("units", [1, 3])
def test_small_oscillation_against_linearisation(units):
    system, draws = structure(f"ogden_4_units_{units}", 1e-10), paper_draws(units, eta_0=0.02)
    held = system.structure(draws)
    lever, mass = LENGTH * np.sin(REST), held.mass(held.rest)[0]
    matrix = np.zeros((units + 2, units + 2))
    matrix[0, 1] = 1.0
    matrix[1, 0] = -held.stiffness(held.rest)[0] / mass
    matrix[1, 1] = -0.02 * lever**2 / mass
    for i in range(units):
        matrix[1, 2 + i] = lever * draws[f"k_{i + 1}"][0] / mass
        matrix[2 + i, 1] = -lever
        matrix[2 + i, 2 + i] = -1.0 / draws[f"tau_{i + 1}"][0]
    values, vectors = np.linalg.eig(matrix)
    kick = -held.electric[0] * np.sin(REST) * np.cos(REST) * 20.0**2 / mass
    times = np.linspace(0.0, 0.1, 200)
    force = np.zeros(units + 2)
    force[1] = kick
    share = np.linalg.solve(vectors, force) / values
    expected = ((vectors[0] * share) @ (np.exp(np.outer(values, times)) - 1.0)).real
    found = system.predict(voltage([0.0, 1.0], [20.0, 20.0]), times, "displacement", draws)[0]
    assert found == pytest.approx(-lever * expected, abs=2e-4 * np.ptp(found))
    if units == 1:
        fastest = np.max(np.abs(values.imag)) / (2.0 * np.pi)
        assert system.derived(draws)["natural_frequency"].values[0] == pytest.approx(
            fastest, rel=0.05
        )


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


def test_after_long_it_stands_in_equilibrium():
    draws = paper_draws()
    system = structure()
    held = system.predict(voltage([0.0, 2e4], [4e3, 4e3]), [1.9e4], "displacement", draws)
    angle = system.structure(draws).equilibrium(4e3)
    assert held[0, 0] == pytest.approx(LENGTH * (np.cos(angle[0]) - np.cos(REST)), rel=1e-5)


def test_prehistory_of_equilibrium_stays_where_it_is():
    times = np.linspace(0.0, 5.0, 20)
    driven = voltage([0.0, 5.0], [4e3, 4e3], prehistory="equilibrium")
    draws = paper_draws()
    found = structure().predict(driven, times, "displacement", draws)[0]
    angle = structure().structure(draws).equilibrium(4e3)[0]
    assert found == pytest.approx(LENGTH * (np.cos(angle) - np.cos(REST)), rel=1e-8)
    with pytest.raises(UserError, match="prehistory"):
        structure().simulator(voltage([0, 1], [1, 1], prehistory="long"), times, "displacement")


@pytest.mark.parametrize("name", ["ogden_4_units_4", "ogden_4_units_4_dry"])
def test_without_voltage_it_rests(name):
    driven, draws = voltage([0.0, 3.0], [0.0, 0.0]), paper_draws(friction_force=1e-3)
    found = structure(name).predict(driven, np.linspace(0.0, 3.0, 9), "displacement", draws)
    assert np.max(np.abs(found)) < 1e-10, "more than the film's polynomial misses"


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
