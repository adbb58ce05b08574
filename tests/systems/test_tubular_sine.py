from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.biased_sines import BiasedSine, SineResponse
from tests.shared.golden import golden_table, load_golden
from tests.shared.tubes import actuator, circuit, harmonic, pressure_per_square

from deabayes.systems.tubular.circuit import Circuit
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
def test_golden_resonance(load):
    expected = load_golden("tubular_frf")["inputs"]["resonance"][f"{load} g"]
    frequency, gain = harmonic(actuator(2, load), 2000.0).peak()
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
        current = (sine(t) - volts) / series - volts / leak
        return np.append(motion / rate, current / capacitance / kilovolt)

    start = np.zeros(size + 1)
    return solve_ivp(slope, (0, time[-1]), start, "DOP853", time, rtol=1e-13, atol=1e-17).y[0]


def test_closed_form_against_integration():
    tube, sine, time = lossy(), BiasedSine(600.0, 1500.0, 25.0), np.linspace(0.0, 0.2, 101)
    strain = tube.strain(sine, time)
    for w in range(2):
        close(strain[w], integrated(tube, w, sine, time), 1e-10)


def test_harmonic_response_is_that_of_the_steady_strain():
    tube, sine, frequency = lossy(), BiasedSine(500.0, 2000.0, 20.0), np.array([1.0, 20.0, 100.0])
    response = harmonic(tube, 2000.0).per_volt(frequency)
    time = np.arange(64) / (64 * 20.0)
    strain = tube.strain(sine, time, lasting=True)
    projected = 2.0 * np.mean(strain * np.exp(-1j * sine.angular * time), axis=1)
    np.testing.assert_allclose(1j * projected / 500.0, response[:, 1], rtol=1e-11)
    halved = harmonic(tube, 1000.0).per_volt(frequency)
    np.testing.assert_allclose(response, 2.0 * halved, rtol=1e-13)
    close(tube.strain(sine, 6.0 + time), strain, 1e-11)


def test_repeated_poles_are_no_special_case():
    """Two units of one time constant: partial fractions would divide by zero."""
    chain = Chain(np.array([1e-6]), np.array([[1e-7, 1e-7]]), np.array([[0.01, 0.01]]))
    tube = SineResponse(circuit(), MovingChain(chain, np.array([20.0])), pressure_per_square())
    sine, time = BiasedSine(600.0, 1500.0, 25.0), np.linspace(0.0, 0.1, 51)
    close(tube.strain(sine, time)[0], integrated(tube, 0, sine, time), 1e-10)


def test_a_draw_is_computed_alike_in_any_company():
    both, frequency = harmonic(lossy(), 2000.0), np.linspace(0.0, 100.0, 21)
    chain, inertia = both.chain.chain, both.chain.inertia[1:]
    parts = (getattr(chain, f.name)[1:] for f in fields(chain))
    rest = (getattr(both.circuit, f.name)[1:] for f in fields(both.circuit))
    alone = replace(
        both,
        chain=MovingChain(Chain(*parts), inertia),
        circuit=Circuit(*rest),
        pressure_per_square=both.pressure_per_square[1:],
    )
    assert np.array_equal(alone.per_volt(frequency)[0], both.per_volt(frequency)[1])
    assert alone.peak()[0][0] == both.peak()[0][1]
