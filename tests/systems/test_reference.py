import io
from dataclasses import replace

import numpy as np
import pytest
import yaml
from data.make import tubular
from data.make import tubular_frequency as analyser
from data.make.sensor import Sensor, ornstein_uhlenbeck
from data.make.tubular_motion import leakage_current, motion
from data.make.tubular_truth import CURRENT, DISPLACEMENT, TRUTH
from scipy.integrate import solve_ivp
from tests.shared.golden import REPOSITORY
from tests.shared.shipped import check_regenerated, table

from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import Harmonic
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain
from deabayes.units import to_si

SHIPPED = REPOSITORY / "data" / "tubular"


def last_digit(path):
    """What one turned rounding changes, per column: of the time nothing, of a sensor two digits."""
    first = path.read_text().splitlines()[1].split(",")
    digits = [10.0 ** -len(cell.partition(".")[2]) for cell in first]
    return [1e-9, *(5.1 * digit for digit in digits[1:])]


@pytest.fixture(scope="module")
def regenerated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tubular")
    tubular.write(folder)
    return folder


def test_the_shipped_specimen_is_what_the_script_writes(regenerated):
    check_regenerated(regenerated, SHIPPED, last_digit)


def sine(time):
    return 1250.0 * np.sin(20.0 * np.pi * time) + 1250.0


def test_the_amplifier_keeps_to_its_current_and_the_capacitance_charges():
    moved = motion(TRUTH, lambda t: 2500.0, 0.05)
    time = np.linspace(0.0, 0.01, 4001)
    voltage, current = moved.amplifier(time), moved.current(time)
    jump = TRUTH.current_limit * TRUTH.series_resistance
    assert voltage[0] == pytest.approx(jump)
    assert voltage.max() == pytest.approx(2500.0, rel=1e-12)
    assert current.max() == TRUTH.current_limit
    # (V - R_S I) C / I, leakage aside
    end = (2500.0 - jump) * TRUTH.capacitance / TRUTH.current_limit
    assert time[np.argmax(voltage >= 2499.999)] == pytest.approx(end, abs=5e-6)
    before = np.array([-1e-4])
    assert moved.amplifier(before)[0] == moved.current(before)[0] == 0.0
    assert moved.displacement(before)[0] == 0.0


def test_motion_agrees_with_an_implicit_solver():
    """DOP853 and what it shows between its steps, under a load, against Radau."""
    load, times = 0.1, np.array([0.001, 0.0029, 0.0105, 0.0413, 0.1, 0.2])
    moved = motion(TRUTH, sine, 0.2, load)

    def slope(t, y):
        current = np.clip((sine(t) - 2500.0 * y[0]) / 1010.0, -0.12, 0.12)
        stress = 1.5e6 * (y[1] - y[3:].sum())
        pressure = 8.8541878188e-12 * 3.1 * (2500.0 * y[0] / 80e-6) ** 2
        mass = (0.0469 + 0.5 * (0.1005 - 0.0469) + 0.0103 + load) * 0.07 / 6.08e-4
        units = zip(TRUTH.E[1:], TRUTH.tau, y[3:], strict=True)
        return [
            (current - 2500.0 * y[0] / 1.1e9) / 181.2e-9 / 2500.0,
            y[2],
            (pressure - stress) / mass,
            *((stress / e - x) / tau for e, tau, x in units),
        ]

    state = solve_ivp(slope, (0, 0.2), np.zeros(6), "Radau", times, rtol=1e-10, atol=1e-13).y
    assert moved.displacement(times) == pytest.approx(0.07 * state[1], rel=1e-6)
    current = np.clip((sine(times) - 2500.0 * state[0]) / 1010.0, -0.12, 0.12)
    assert moved.current(times) == pytest.approx(current, rel=1e-6)
    assert moved.amplifier(times) == pytest.approx(2500.0 * state[0] + 1010.0 * current, rel=1e-6)


def test_late_leakage_current_gives_the_resistance():
    early, late = leakage_current(TRUTH, 2000.0, np.array([0.1, 175.0]))
    assert late * TRUTH.leakage_resistance == pytest.approx(2000.0, rel=1e-3)
    absorbed = 2000.0 * sum(TRUTH.absorbing[k] / TRUTH.absorption_time[k] for k in range(2))
    assert early - late == pytest.approx(absorbed, rel=0.03)


@pytest.mark.parametrize("load", [0.1, 0.5])
def test_harmonic_balance_agrees_with_the_transfer_function(load):
    """The inference's closed form knows no absorption, which takes 1e-5 of the current."""
    one = np.ones(1)
    actuator = Harmonic(
        MovingChain(
            Chain(one / TRUTH.E[0], 1.0 / np.array([TRUTH.E[1:]]), np.array([TRUTH.tau])),
            TRUTH.inertia(load) * one,
        ),
        Circuit(1010.0 * one, 1.1e9 * one, 181.2e-9 * one),
        TRUTH.pressure(1.0) * one,
        2000.0,
    )
    frequency = np.array([1.0, 10.0, 22.5, 41.0, 100.0])
    found = [analyser.harmonic(TRUTH, 2000.0, f, load) for f in frequency]
    expected = actuator.per_volt(frequency)[0]
    assert found == pytest.approx(expected, rel=3e-5)


def test_the_analysers_error_is_smooth_and_its_noise_small():
    frequency = np.arange(1.0, 100.25, 0.5)
    exact = np.array([analyser.harmonic(TRUTH, 2000.0, f, 0.1) for f in frequency])
    exact = exact * np.exp(-2j * np.pi * frequency * 4e-4)
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        gain, phase = analyser.measured(
            TRUTH, DISPLACEMENT, 500.0, 2000.0, frequency, 0.1, rng
        )  # fmt: skip
        errors.append(gain * np.exp(1j * phase) / exact - 1.0)
    errors = np.array(errors)
    for part in (errors.real, errors.imag):
        assert part.std() == pytest.approx(0.01, rel=0.15)
        near = np.mean(part[:, 20:] * part[:, :-20]) / np.mean(part**2)  # 10 Hz apart
        assert near == pytest.approx(np.exp(-1.0), abs=0.12)


def test_the_noise_of_a_harmonic_is_that_of_the_averaged_sensor():
    """Readings of 20 periods of 100 Hz at 10 kHz, multiplied by the sine: two quadratures."""
    time = np.arange(2000) * 1e-4
    rng = np.random.default_rng(5)
    still = replace(DISPLACEMENT, offset=0.0, drift=0.0, resolution=1e-12)
    readings = np.array([still.read(np.zeros_like, time, rng) for _ in range(200)])
    found = 2.0 * readings @ np.exp(-2j * np.pi * 100.0 * time) / time.size
    expected = analyser.noise_per_volt(TRUTH, DISPLACEMENT, 500.0, np.array([100.0]))[0]
    for part in (found.real, found.imag):
        assert part.std() == pytest.approx(0.07 * 500.0 * expected, rel=0.15)


def test_sensor_delays_and_quantises():
    time = np.arange(200) * 1e-3
    exact = Sensor(5e-3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.25)
    reading = exact.read(lambda t: 10.0 * t, time, np.random.default_rng(0))
    assert np.abs(reading - 10.0 * (time - 5e-3)).max() <= 0.125
    assert np.all(reading % 0.25 == 0.0)


def test_sensor_noise_has_the_stated_size_and_correlation():
    rng = np.random.default_rng(1)
    time = np.arange(200_000) * 1e-3
    path = ornstein_uhlenbeck(time, 0.01, rng)
    assert path.std() == pytest.approx(1.0, abs=0.05)
    correlation = np.mean(path[10:] * path[:-10]) / path.var()
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.04)
    rest = table(SHIPPED / "records" / "creep_2000V.csv")[:199]
    assert 0.8e-3 < rest[:, 2].std() < 2.5e-3  # 1.4 um


HEADERS = {
    "creep_1500V": "time [s],voltage [kV],displacement [mm]",
    "sine_10Hz": "time [s],voltage [kV],current [mA],displacement [mm]",
    "leakage_2000V": "time [s],voltage [kV],current [uA]",
    "frequency_response_300g": "frequency [Hz],gain [%/V],phase [deg]",
}


def test_records_are_read_as_quantities_of_the_specimen():
    specimen = yaml.safe_load((SHIPPED / "specimen.yaml").read_text())
    assert specimen["provenance"]["kind"] == "simulated"
    for name, expected in HEADERS.items():
        header = io.StringIO((SHIPPED / "records" / f"{name}.csv").read_text()).readline()
        assert header.strip() == expected
    truth = yaml.safe_load((SHIPPED / "truth.yaml").read_text())
    assert truth["parameters"]["E_3"] == TRUTH.E[3]
    for name, true in truth["specimen"].items():
        stated = specimen["quantities"].get(name, {"value": 0.0})
        if "sd" in stated:
            size = to_si(np.array([stated["value"], stated["sd"]]), stated["unit"])
            assert abs(true - size[0]) <= 1.1 * size[1], name


def test_the_shipped_records_show_what_was_put_in():
    rest = table(SHIPPED / "records" / "sine_10Hz.csv")[:10]
    assert abs(rest[:, 2].std() - 1e3 * CURRENT.sigma_white) < 0.01
    rows = table(SHIPPED / "records" / "sine_10Hz.csv")
    volts = rows[rows[:, 0] > 0.1]
    assert volts[:, 1] == pytest.approx(1e-3 * sine(volts[:, 0] - 0.005), abs=2e-3)
    phase = table(SHIPPED / "records" / "frequency_response_100g.csv")[:, 2]
    assert np.all((phase > -180.0) & (phase <= 180.0)) and np.ptp(phase) > 300.0
