import io

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from tests.unit.golden import REPOSITORY

from deabayes.reference import tubular
from deabayes.reference.sensor import Sensor, ornstein_uhlenbeck

SHIPPED = REPOSITORY / "data" / "tubular"


def table(path):
    return np.loadtxt(path, delimiter=",", skiprows=1)


@pytest.fixture(scope="module")
def regenerated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tubular")
    tubular.write(folder)
    return folder


def test_the_shipped_specimen_is_what_the_script_writes(regenerated):
    for name in ("experiments.csv", "specimen.yaml", "truth.yaml"):
        assert (regenerated / name).read_text() == (SHIPPED / name).read_text()
    records = sorted(path.name for path in (SHIPPED / "records").iterdir())
    assert records == sorted(path.name for path in (regenerated / "records").iterdir())
    for name in records:
        difference = table(regenerated / "records" / name) - table(SHIPPED / "records" / name)
        # Another machine's last bit may turn one rounding over.
        assert np.mean(np.any(np.abs(difference) > 1e-9, axis=1)) < 0.01
        assert np.all(np.abs(difference) < [1e-9, 1.1e-4, 2.1e-4])
        assert (SHIPPED / "records" / name).stat().st_size < 250_000


def test_the_amplifier_keeps_to_its_current_and_the_capacitance_charges():
    truth = tubular.TRUTH
    amplifier, _ = tubular.step_response(truth, 2500.0, 0.5)
    time = np.linspace(0.0, 0.01, 4001)
    voltage = amplifier(time)
    assert voltage[0] == pytest.approx(truth.current_limit * truth.series_resistance)
    assert voltage.max() == 2500.0
    # (V - R_S I) C / I, leakage aside
    end = (2500.0 - voltage[0]) * truth.capacitance / truth.current_limit
    assert time[np.argmax(voltage >= 2499.999)] == pytest.approx(end, abs=5e-6)
    assert amplifier(np.array([-1e-4]))[0] == 0.0


def test_displacement_agrees_with_an_implicit_solver():
    truth, voltage = tubular.TRUTH, 2000.0
    _, displacement = tubular.step_response(truth, voltage, 0.5)

    def slope(t, state):
        current = min((voltage - state[0]) / truth.series_resistance, truth.current_limit)
        pressure = 8.8541878188e-12 * 3.1 * (state[0] / 80e-6) ** 2
        units = zip(state[1:], truth.E[1:], truth.tau, strict=True)
        return [
            (current - state[0] / truth.leakage_resistance) / truth.capacitance,
            *((pressure / e - x) / tau for x, e, tau in units),
        ]

    time = np.array([0.001, 0.0029, 0.01, 0.1, 0.5])
    state = solve_ivp(slope, (0, 0.5), np.zeros(4), "Radau", time, rtol=1e-9, atol=1e-12).y
    strain = 8.8541878188e-12 * 3.1 * (state[0] / 80e-6) ** 2 / 1.5e6 + state[1:].sum(axis=0)
    assert displacement(time) == pytest.approx(0.07 * strain, rel=1e-7)


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


def test_records_are_read_as_quantities_of_the_specimen():
    specimen = yaml.safe_load((SHIPPED / "specimen.yaml").read_text())
    assert specimen["provenance"]["kind"] == "simulated"
    assert "Inertia is left out" in specimen["provenance"]["source"]
    header = io.StringIO((SHIPPED / "records" / "creep_1500V.csv").read_text()).readline()
    assert header.strip() == "time [s],voltage [kV],displacement [mm]"
    truth = yaml.safe_load((SHIPPED / "truth.yaml").read_text())
    assert truth["parameters"]["E_3"] == tubular.TRUTH.E[3]
