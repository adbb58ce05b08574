import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.golden import golden_table
from tests.shared.tubes import circuit, pressure_per_square

from deabayes.systems.tubular.circuit import (
    Circuit,
    time_constant_from_phase,
    time_constant_interval,
)
from deabayes.systems.tubular.sine import (
    BiasedSine,
    charge_coefficients,
    charge_series,
    pressure_series,
)

SINE = BiasedSine(1250.0, 1250.0, 10.0)
SLOW = Circuit(np.array([2e4]), np.array([3e5]), np.array([180e-9]))
"""Everything about it shows at 10 Hz: tau_e = 3.4 ms, a leak of 6 %."""
TIME = np.linspace(0.0, 0.15, 151)
STRICT = {"rtol": 1e-13, "atol": 1e-9, "max_step": 1e-3}
"""A longer step is as good, but interpolates badly between."""


def close(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


def test_golden_circuit():
    table = golden_table("tubular_circuit_sine", "circuit")
    time, square = table["time"], pressure_per_square()
    charged = charge_series(circuit(), SINE)(time)
    np.testing.assert_allclose(charged[0, 1:], table["v_C"][1:], rtol=1e-12)
    assert abs(charged[0, 0]) < 1e-12 * SINE.amplitude
    np.testing.assert_allclose(square[0] * charged[0, 1:] ** 2, table["pressure"][1:], rtol=1e-12)
    close(pressure_series(circuit(), SINE, square)(time)[0], table["pressure"], 1e-12)
    # Charged and amplifier voltage differ by little, so the tolerance is of the peak.
    close(circuit().current(table["v_AMP"], charged)[0], table["amplifier_current"], 1e-12)


def integrated():
    """v_C of the slow circuit by DOP853."""

    def slope(t, v):
        amplifier = SINE.amplitude * np.sin(SINE.angular * t) + SINE.bias
        return (amplifier / SLOW.series_resistance - v / leak) / SLOW.capacitance

    leak = 1.0 / (1.0 / SLOW.series_resistance + 1.0 / SLOW.leakage_resistance)
    return solve_ivp(slope, (0, TIME[-1]), [0.0], "DOP853", TIME, **STRICT).y[0]


def test_the_series_are_the_solution():
    charged = integrated()
    close(charge_series(SLOW, SINE)(TIME)[0], charged, 1e-11)
    square = np.array([0.0043])
    close(pressure_series(SLOW, SINE, square)(TIME)[0], square * charged**2, 1e-11)


def test_the_series_as_printed_are_not():
    charged, square = integrated(), 0.0043
    a_1, a_2, a_3, a_4 = (
        values[0, 0]
        for values in charge_coefficients(SLOW, 1250.0, 1250.0, np.array([SINE.angular]))
    )
    tau, leakage = SLOW.time_constant[0], SLOW.leakage_resistance[0]
    lasting = a_1 * np.sin(SINE.angular * TIME) - a_2 * np.cos(SINE.angular * TIME) + a_4

    def error(voltage, power=1):
        expected = square * charged**2 if power == 2 else charged
        return np.abs(voltage - expected).max() / np.abs(expected).max()

    right = lasting + a_3 * np.exp(-TIME / tau)
    assert error(right) < 1e-11
    # (8): exp(-tau_e t) hardly decays
    assert error(lasting + a_3 * np.exp(-tau * TIME)) > 0.1
    # A_3 without the factor R_L in its first term: charged before it starts
    assert error(lasting + (a_2 / leakage - a_4) * np.exp(-TIME / tau)) > 0.1
    # (10): the same exponent in the pressure
    series = pressure_series(SLOW, SINE, np.array([square]))
    as_printed = type(series)(
        series.coefficients,
        np.where(series.rates.real < 0.0, series.rates.real * tau**2, 0.0) + 1j * series.rates.imag,
    )
    assert error(series(TIME)[0], 2) < 1e-11
    assert error(as_printed(TIME)[0], 2) > 0.1


def test_any_recorded_voltage_charges_exactly():
    volts = np.array([0.0, 2000.0, 500.0])
    knots, time = np.array([0.0, 0.01, 0.05]), np.linspace(0.0, 0.05, 101)
    found = SLOW.charge(knots, volts, time)[0]
    gain, tau = SLOW.gain[0], SLOW.time_constant[0]
    rise, fall = 2000.0 / 0.01, -1500.0 / 0.04
    after = np.clip(time - 0.01, 0.0, None)
    expected = gain * (
        rise * (time - tau * -np.expm1(-time / tau))
        + (fall - rise) * (after - tau * -np.expm1(-after / tau))
    )
    close(found, expected, 1e-13)


def test_every_draw_is_charged_at_times_of_its_own():
    """Against the sum of what jumps and kinks of the voltage do; a leak of 9 to 50 %."""
    knots = 1e-3 * np.array([0, 0, 5, 10, 10, 20])
    volts = np.array([100.0, 500.0, 2000.0, 2000.0, 300.0, 900.0])
    jumps, kinks = {0.0: 500.0, 0.01: -1700.0}, {0.0: 3e5, 0.005: -3e5, 0.01: 6e4, 0.02: -6e4}
    several = Circuit(np.array([1e2, 1e3, 2e4, 1e5]), np.geomspace(1e3, 1e5, 4), np.full(4, 1e-7))
    rng = np.random.default_rng(3)
    even = np.arange(-2e-3, 0.03, 1e-4) - rng.uniform(0.0, 1e-3, 4)[:, None]
    times = np.hstack([even, rng.uniform(-2e-3, 0.03, (4, 100)), np.tile(knots, (4, 1))])
    tau, expected = several.time_constant[:, None], np.zeros_like(times)
    for at in kinks:
        since = np.clip(times - at, 0.0, None)
        grown = -np.expm1(-since / tau)
        expected += jumps.get(at, 0.0) * grown + kinks[at] * (since - tau * grown)
    expected *= several.gain[:, None]
    np.testing.assert_allclose(several.charge(knots, volts, times), expected, atol=1e-10, rtol=0)


def test_a_circuit_that_is_none_is_charged_to_nothing_known():
    pair = Circuit(np.array([-1e3, 1e3]), np.full(2, 1e9), np.full(2, 1e-7))
    found = pair.charge(np.array([0.0, 0.01]), np.array([0.0, 1e3]), TIME)
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()


def test_current_limit():
    """(16) is the amplitude of the current where the leak is negligible."""
    limit = circuit().current_amplitude(500.0, np.array([100.0, 1000.0]))
    tight = Circuit(np.array([954.0]), np.array([1e15]), np.array([180e-9]))
    for frequency, amplitude in zip((100.0, 1000.0), limit[0], strict=True):
        a_1, a_2, _, _ = charge_coefficients(tight, 500.0, 0.0, np.array([2.0 * np.pi * frequency]))
        current = np.hypot(500.0 - a_1, a_2) / 954.0
        assert amplitude == pytest.approx(current[0, 0], rel=1e-6)
    assert limit[0, 0] == pytest.approx(0.0562, rel=0.01)
    assert limit[0, 1] > 0.12


def test_phase_method_and_what_rounding_leaves():
    """Sarban et al. 2012: 1.56 rad at 10 Hz is 1.72e-4 s; its rounding allows 0.92 to 2.51."""
    assert time_constant_from_phase(1.56, 10.0) == pytest.approx(1.72e-4, rel=1e-3)
    least, most = time_constant_interval(1.56, 0.01, 10.0)
    assert (least, most) == pytest.approx((0.92e-4, 2.51e-4), rel=5e-3)
    assert time_constant_interval(1.57, 0.01, 10.0)[0] == pytest.approx(0.0, abs=1e-15)
    assert np.isnan(time_constant_from_phase(1.58, 10.0))
    assert np.isnan(time_constant_interval(1.58, 0.01, 10.0)).all()
