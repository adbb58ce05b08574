import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.biased_sines import BiasedSine
from tests.shared.tubes import circuit

from deabayes.systems.tubular.circuit import (
    Circuit,
    time_constant_from_phase,
    time_constant_interval,
)

SINE = BiasedSine(1250.0, 1250.0, 10.0)
SLOW = Circuit(np.array([2e4]), np.array([3e5]), np.array([180e-9]))
"""Everything about it shows at 10 Hz: tau_e = 3.4 ms, a leak of 6 %."""
TIME = np.linspace(0.0, 0.15, 151)
STRICT = {"rtol": 1e-13, "atol": 1e-9, "max_step": 1e-3}
"""A longer step is as good, but interpolates badly between."""


def close(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


def integrated():
    """v_C of the slow circuit by DOP853."""

    def slope(t, v):
        return (SINE(t) / SLOW.series_resistance - v / leak) / SLOW.capacitance

    leak = 1.0 / (1.0 / SLOW.series_resistance + 1.0 / SLOW.leakage_resistance)
    return solve_ivp(slope, (0, TIME[-1]), [0.0], "DOP853", TIME, **STRICT).y[0]


def test_two_printed_equations_are_not_the_solution():
    """(8) with its exponent and its A_3 as printed; corrected, it is the solution."""
    charged, gain = integrated(), SLOW.gain[0]
    tau, leakage = SLOW.time_constant[0], SLOW.leakage_resistance[0]
    turned = gain * SINE.amplitude / (1.0 + 1j * SINE.angular * tau)
    a_2, a_4 = -turned.imag, gain * SINE.bias
    lasting = (turned * np.exp(1j * SINE.angular * TIME)).imag + a_4

    def error(voltage):
        return np.abs(voltage - charged).max() / charged.max()

    assert error(lasting + (a_2 - a_4) * np.exp(-TIME / tau)) < 1e-11
    # exp(-tau_e t) hardly decays
    assert error(lasting + (a_2 - a_4) * np.exp(-tau * TIME)) > 0.1
    # A_3 without the factor R_L in its first term: charged before it starts
    assert error(lasting + (a_2 / leakage - a_4) * np.exp(-TIME / tau)) > 0.1


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
    for frequency, amplitude in zip((100.0, 1000.0), limit[0], strict=True):
        impedance = 954.0 + 1.0 / (2j * np.pi * frequency * 180e-9)
        assert amplitude == pytest.approx(500.0 / abs(impedance), rel=1e-9)
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
