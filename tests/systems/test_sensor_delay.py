"""A sensor's delay that is known with an error: a parameter of the tubular actuator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.golden import golden_table
from tests.shared.tubes import QUANTITIES
from tests.systems.test_tubular_frequency_response import CIRCUIT, WHOLE, draws, driven

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.systems.tubular.system import Tubular

LATE = np.array([4e-4, 3.2e-4, 5.1e-4])
TIME = np.arange(0.0, 0.3, 1e-3)


def specimen(sd=5e-5, **instruments):
    delay = {"sensor_delay": Quantity(4e-4, "s", sd)}
    kind = {"kind": "simulated"}
    return Specimen("tube", "tubular", kind, QUANTITIES | CIRCUIT | delay, instruments)


def raised():
    """A voltage raised within 3 ms after 10 ms of rest: the tube rings at 62 Hz."""
    return Excitation("voltage", "V", np.array([0.0, 0.01, 0.013, 0.3]), np.array([0, 0, 2e3, 2e3]))


def on_time(time):
    exact = replace(specimen(), quantities=QUANTITIES | CIRCUIT)
    return Tubular(WHOLE, exact).predict(raised(), time, "strain", draws())[0]


def test_it_is_a_parameter_if_it_has_an_sd():
    names = {p.name: p.unit for p in Tubular(WHOLE, specimen()).parameters()}
    assert names["sensor_delay"] == "s"
    assert "sensor_delay" not in {p.name for p in Tubular(WHOLE, specimen(None)).parameters()}


def test_an_exact_delay_shifts_the_response():
    found = Tubular(WHOLE, specimen(None)).predict(raised(), TIME, "strain", draws())[0]
    np.testing.assert_array_equal(found, on_time(np.maximum(TIME - 4e-4, 0.0)))


def test_every_draw_has_its_own_delay():
    three = {name: np.repeat(values, 3) for name, values in draws().items()}
    found = Tubular(WHOLE, specimen()).predict(
        raised(), TIME, "strain", three | {"sensor_delay": LATE}
    )
    for row, late in zip(found, LATE, strict=True):
        expected = on_time(np.maximum(TIME - late, 0.0))
        assert np.abs(row - expected).max() < 2e-6 * np.ptp(expected)
    assert np.abs(found[1] - found[2]).max() > 1e-2 * np.ptp(found[0])


@pytest.mark.parametrize("sd", [None, 5e-5])
def test_nothing_is_seen_of_a_first_jump_before_the_delay_is_over(sd):
    """A chain without mass strains at once: 29 % of its final strain were seen too early."""
    jump = Excitation("voltage", "V", np.array([0.0, 0.3]), np.array([2e3, 2e3]))
    time = np.append(-1e-3, np.arange(0.0, 0.02, 1e-4))
    three = {name: np.repeat(values, 3) for name, values in draws().items()}
    late = LATE if sd else np.full(3, 4e-4)
    found = Tubular("voigt_kelvin_2", specimen(sd)).predict(
        jump, time, "strain", three | {"sensor_delay": late}
    )
    exact = Tubular("voigt_kelvin_2", replace(specimen(), quantities=QUANTITIES))
    for row, delay in zip(found, late, strict=True):
        expected = exact.predict(jump, time - delay, "strain", draws())[0]
        assert np.abs(row - expected).max() < 3e-4 * np.ptp(expected)


@pytest.mark.parametrize("response", ["strain", "displacement"])
@pytest.mark.parametrize("rise", [0.0, 1e-4])
def test_a_jump_inside_the_record_is_seen_when_each_delay_is_over(rise, response):
    """One or two samples were wrong by 62 % of the range, 14 % where it rises within 0.1 ms."""
    at = [0.0, 0.01, 0.01 + rise, 0.02, 0.02 + rise, 0.3]
    jumps = Excitation("voltage", "V", np.array(at), 2e3 * np.array([0.2, 0.2, 1, 1, 0.5, 0.5]))
    time = np.arange(0.0, 0.03, 5e-5)
    three = {name: np.repeat(values, 3) for name, values in draws().items()}
    found = Tubular("voigt_kelvin_2", specimen()).predict(
        jumps, time, response, three | {"sensor_delay": LATE}
    )
    exact = Tubular("voigt_kelvin_2", replace(specimen(), quantities=QUANTITIES))
    for row, delay in zip(found, LATE, strict=True):
        expected = exact.predict(jumps, time - delay, response, draws())[0]
        assert np.abs(row - expected).max() < 3e-4 * np.ptp(expected)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("time_constant", [1e-5, 1.7e-4, 1e-3])
@pytest.mark.parametrize("rise", [0.0, 1e-4])
def test_a_fast_circuit_charges_when_each_delay_is_over(rise, time_constant, even):
    """A chain without mass follows v_C^2 at once: up to 60 % of the range were wrong."""
    at = [0.0, 0.01, 0.01 + rise, 0.02, 0.02 + rise, 0.3]
    jumps = Excitation("voltage", "V", np.array(at), 2e3 * np.array([0.2, 0.2, 1, 1, 0.5, 0.5]))
    time = np.append(-1e-3, np.arange(0.0, 0.03, 5e-5))
    if not even:
        time = np.sort(np.random.default_rng(1).uniform(-1e-3, 0.03, 200))
    resistance = np.array([0.8, 1.0, 1.5]) * time_constant / CIRCUIT["capacitance"].value
    three = {name: np.repeat(values, 3) for name, values in draws().items()}
    three |= {"series_resistance": resistance, "sensor_delay": LATE}
    candidate = "voigt_kelvin_2_circuit"
    found = Tubular(candidate, specimen()).predict(jumps, time, "displacement", three)
    exact = Tubular(candidate, replace(specimen(), quantities=QUANTITIES | CIRCUIT))
    for n, delay in enumerate(LATE):
        one = draws() | {"series_resistance": resistance[n : n + 1]}
        expected = exact.predict(jumps, time - delay, "displacement", one)[0]
        assert np.abs(found[n] - expected).max() < 4e-4 * np.ptp(expected)


@pytest.mark.parametrize("candidate", ["voigt_kelvin_2", "voigt_kelvin_2_circuit"])
@pytest.mark.parametrize("name", ["E_0", "tau_1", "thickness"])
def test_an_impossible_draw_fails_alone(name, candidate):
    three = {key: np.repeat(values, 3) for key, values in draws().items()}
    three |= {"thickness": np.full(3, 80e-6), "sensor_delay": LATE}
    spoilt = three | {name: three[name] * np.array([1.0, -1.0, 1.0])}
    system = Tubular(candidate, specimen())
    found, whole = (system.predict(raised(), TIME, "strain", d) for d in (spoilt, three))
    assert np.isnan(found[1, TIME > 1e-3]).all()
    np.testing.assert_array_equal(found[[0, 2]], whole[[0, 2]])


def test_it_is_in_the_phase_and_not_in_the_gain():
    table = golden_table("tubular_frf", "load_100g")
    at = driven(table["frequency"], load_g=100)
    system = Tubular(WHOLE, specimen())
    two = {name: np.repeat(values, 2) for name, values in draws().items()}
    two["sensor_delay"] = np.array([4e-4, 5e-4])
    gain, phase = (system.predict(at, table["frequency"], what, two) for what in ("gain", "phase"))
    np.testing.assert_array_equal(gain[0], gain[1])
    np.testing.assert_allclose(np.rad2deg(phase[0]), table["phase_as_measured"], rtol=1e-10)
    np.testing.assert_allclose(phase[0] - phase[1], 2e-4 * np.pi * table["frequency"], rtol=1e-9)


@pytest.mark.parametrize("instrument", ["delay", "displacement.delay"])
def test_a_delay_stated_twice_is_refused(instrument):
    with pytest.raises(UserError, match="states the sensor's delay twice"):
        Tubular(WHOLE, specimen(**{instrument: Quantity(4e-4, "s")}))
    Tubular(WHOLE, specimen(**{instrument: Quantity(0.0, "s")}))
