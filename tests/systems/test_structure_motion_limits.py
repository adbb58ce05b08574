"""Minimum-energy structure in motion: energy is kept, and limits are the known ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from tests.shared.structures import (
    LENGTH,
    REST,
    paper_draws,
    sine,
    specimen,
    structure,
    voltage,
)

from deabayes.experiment import Quantity
from deabayes.faults import UserError
from deabayes.systems.minimum_energy_structure.kernel import DRY_SPEED


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
    early = structure().predict(driven, times - 1.0, "displacement", draws)[0]
    assert early == pytest.approx(found, rel=1e-8), "before the first knot, too"
    with pytest.raises(UserError, match="prehistory"):
        structure().simulator(voltage([0, 1], [1, 1], prehistory="long"), times, "displacement")


@pytest.mark.parametrize("name", ["ogden_4_units_4", "ogden_4_units_4_dry"])
def test_without_voltage_it_rests(name):
    driven, draws = voltage([0.0, 3.0], [0.0, 0.0]), paper_draws(friction_force=1e-3)
    found = structure(name).predict(driven, np.linspace(0.0, 3.0, 9), "displacement", draws)
    assert np.max(np.abs(found)) < 1e-10, "more than the film's polynomial misses"


def _little_stretched(exponent, rest=60.0):
    """A film of pre-stretch 2 on links at a steep angle, and a draw with a single Ogden term."""
    angle, stretch = np.radians(rest), 2.0
    system = structure(
        "ogden_1_units_1",
        specimen=specimen(prestretch=Quantity(stretch, "1"), rest_angle=Quantity(angle, "rad")),
    )
    first = stretch * np.cos(angle)
    modulus = 3e5 / (first**exponent - (1.0 / (stretch * first)) ** exponent)
    values = {"mu_1": modulus, "alpha_1": exponent, "relative_permittivity": 3.0}
    values |= {"k_1": 5.0, "tau_1": 0.5, "eta_0": 0.1}
    return system, {name: np.array([value]) for name, value in values.items()}


@pytest.mark.parametrize("exponent", [-5.0, 10.0])
def test_a_little_stretched_film_moves_as_it_rests(exponent):
    system, draws = _little_stretched(exponent)
    rest = system.structure(draws).rest[0]
    still = system.predict(voltage([0, 2], [0, 0]), np.linspace(0, 2, 9), "displacement", draws)
    held = system.predict(voltage([0, 100], [2e3, 2e3]), [100.0], "displacement", draws)
    angle = system.structure(draws).equilibrium(2e3)[0]
    expected = LENGTH * (np.cos(angle) - np.cos(rest))
    assert np.max(np.abs(still)) < 1e-5 * expected
    assert held[0, 0] == pytest.approx(expected, rel=1e-5)


def test_a_film_that_no_polynomial_follows_fails():
    """At 70 degrees lambda_z^10 grows by a factor of 60 within the last degrees."""
    system, draws = _little_stretched(10.0, 70.0)
    found = system.predict(voltage([0, 2], [0, 0]), np.linspace(0, 2, 9), "displacement", draws)
    assert np.all(np.isnan(found))
