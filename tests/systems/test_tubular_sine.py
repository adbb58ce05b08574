from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.golden import golden_table, load_golden
from tests.shared.tubes import actuator, circuit, pressure_per_square

from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import BiasedSine, SineResponse, fundamental_pressure, phase
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

DELAY = 4e-4
TRANSIENTS = [(2, 0), (2, 100), (2, 300), (2, 500), (1, 100), (3, 100)]


def close(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize(("units", "load"), TRANSIENTS)
def test_golden_transient(units, load):
    table = golden_table("tubular_transient_10hz", f"K{units}_load_{load}g")
    sine, tube = BiasedSine(1250.0, 1250.0, 10.0), actuator(units, load)
    close(tube.strain(sine, table["time"])[0], table["strain"], 1e-11)
    delayed = tube.strain(sine, table["time"], DELAY)[0]
    close(delayed, table["strain_as_measured"], 1e-11)


@pytest.mark.parametrize("load", [100, 300, 500])
def test_golden_frequency_response(load):
    table, tube = golden_table("tubular_frf", f"load_{load}g"), actuator(2, load)
    frequency = table["frequency"]
    response = tube.harmonic(2000.0, frequency)
    np.testing.assert_allclose(100.0 * np.abs(response[0]), table["gain"], rtol=1e-10)
    degrees = np.rad2deg(phase(response, frequency)[0])
    np.testing.assert_allclose(degrees, table["phase"], rtol=1e-10)
    measured = np.rad2deg(phase(response, frequency, DELAY)[0])
    np.testing.assert_allclose(measured, table["phase_as_measured"], rtol=1e-10)


@pytest.mark.parametrize("load", [100, 300, 500])
def test_golden_resonance(load):
    expected = load_golden("tubular_frf")["inputs"]["resonance"][f"{load} g"]
    frequency, gain = actuator(2, load).resonance(2000.0)
    # Written with eight digits; where a gain peaks is known to the root of its rounding.
    assert frequency[0] == pytest.approx(expected["frequency_of_peak_gain_Hz"], rel=2e-8)
    assert 100.0 * gain[0] == pytest.approx(expected["peak_gain_percent_per_V"], rel=1e-10)


def lossy():
    """Two draws of an actuator whose circuit is slow enough to matter."""
    moduli, times = np.array([[1.5e6, 5e6, 6e6], [2e6, 12e6, 3e6]]), np.array([[6e-3, 0.05]] * 2)
    chain = MovingChain(
        Chain(1.0 / moduli[:, 0], 1.0 / moduli[:, 1:], times), np.array([20.0, 45.0])
    )
    slow = Circuit(np.full(2, 2e4), np.full(2, 3e5), np.full(2, 180e-9))
    return SineResponse(slow, chain, np.full(2, 0.0043))


def integrated(tube, w, sine, time):
    """Strain of draw w by DOP853 of circuit, pressure and chain at once."""
    series, leak = tube.circuit.series_resistance[w], tube.circuit.leakage_resistance[w]
    capacitance, chain = tube.circuit.capacitance[w], tube.chain.chain
    space = tube.chain.state_space()
    size = 2 + chain.compliances.shape[1]
    kilovolt, rate = 1e3, np.array([1.0, 250.0, 1.0, 1.0])

    def slope(t, y):
        volts = kilovolt * y[size]
        pressure = tube.pressure_per_square[w] * volts**2
        motion = space.a[w] @ (rate * y[:size]) + space.b[w] * pressure
        amplifier = sine.amplitude * np.sin(sine.angular * t) + sine.bias
        current = (amplifier - volts) / series - volts / leak
        return np.append(motion / rate, current / capacitance / kilovolt)

    start = np.zeros(size + 1)
    return solve_ivp(slope, (0, time[-1]), start, "DOP853", time, rtol=1e-13, atol=1e-17).y[0]


def test_closed_form_against_integration():
    tube, sine, time = lossy(), BiasedSine(600.0, 1500.0, 25.0), np.linspace(0.0, 0.2, 101)
    strain = tube.strain(sine, time)
    for w in range(2):
        close(strain[w], integrated(tube, w, sine, time), 1e-10)


def test_the_transient_leaves_the_steady_part():
    tube, sine = lossy(), BiasedSine(600.0, 1500.0, 25.0)
    late = np.linspace(6.0, 6.04, 41)
    steady = tube.steady_strain(sine, late)
    close(tube.strain(sine, late), steady, 1e-11)
    np.testing.assert_allclose(steady[:, 0], steady[:, -1], rtol=1e-10)
    assert np.abs(tube.strain(sine, late - 6.0) - steady).max() > 0.1 * steady.max()


def test_harmonic_response_is_that_of_the_state_space():
    tube, frequency = lossy(), np.array([1.0, 20.0, 41.3, 100.0])
    response = tube.harmonic(2000.0, frequency)
    gain = tube.chain.state_space().transfer(2j * np.pi * frequency)
    drive = fundamental_pressure(tube.circuit, 500.0, 2000.0, frequency, tube.pressure_per_square)
    np.testing.assert_allclose(response, drive * gain / 500.0, rtol=1e-12)
    # and what a period of the steady strain shows
    sine = BiasedSine(500.0, 2000.0, 20.0)
    time = np.arange(64) / (64 * 20.0)
    strain = tube.steady_strain(sine, time)
    projected = 2.0 * np.mean(strain * np.exp(-1j * sine.angular * time), axis=1)
    np.testing.assert_allclose(1j * projected / 500.0, response[:, 1], rtol=1e-11)


def test_gain_is_in_proportion_to_the_bias():
    tube, frequency = lossy(), np.array([10.0])
    assert tube.harmonic(2000.0, frequency) == pytest.approx(
        2.0 * tube.harmonic(1000.0, frequency), rel=1e-13
    )
    assert np.all(tube.harmonic(0.0, frequency) == 0.0)


def test_repeated_poles_are_no_special_case():
    """Two units of one time constant: partial fractions would divide by zero."""
    chain = Chain(np.array([1e-6]), np.array([[1e-7, 1e-7]]), np.array([[0.01, 0.01]]))
    tube = SineResponse(circuit(), MovingChain(chain, np.array([20.0])), pressure_per_square())
    sine, time = BiasedSine(600.0, 1500.0, 25.0), np.linspace(0.0, 0.1, 51)
    close(tube.strain(sine, time)[0], integrated(tube, 0, sine, time), 1e-10)


def test_a_draw_is_computed_alike_in_any_company():
    both, sine, time = lossy(), BiasedSine(600.0, 1500.0, 25.0), np.linspace(0.0, 0.1, 21)
    chain = both.chain.chain
    alone = SineResponse(
        Circuit(np.full(1, 2e4), np.full(1, 3e5), np.full(1, 180e-9)),
        MovingChain(
            replace(
                chain,
                instantaneous=chain.instantaneous[1:],
                compliances=chain.compliances[1:],
                time_constants=chain.time_constants[1:],
            ),
            both.chain.inertia[1:],
        ),
        both.pressure_per_square[1:],
    )
    assert np.array_equal(alone.strain(sine, time)[0], both.strain(sine, time)[1])
    assert np.array_equal(alone.harmonic(1.0, time)[0], both.harmonic(1.0, time)[1])
    assert alone.resonance(2000.0)[0][0] == both.resonance(2000.0)[0][1]
