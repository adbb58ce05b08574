"""`excitation_spline`: what is left of the circuit's time constant after preparation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from deabayes.experiment import Experiment, Specimen
from deabayes.faults import UserError
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare
from deabayes.systems.tubular.circuit import Circuit, Supply

TUBE = Specimen("tube", "tubular", {"kind": "simulated"}, {})
R_S, R_L, C, OMEGA = 1010.0, 1.1e9, 181.2e-9, 2.0 * np.pi * 10.0
TIME = np.arange(2001) * 5e-4
SPLINE = {"excitation_spline": {"interval": "10 ms", "spacing": "0.04 ms", "from": "0.05 s"}}
CROP = {"crop": {"from": "0.1 s", "to": "0.6 s"}}


def electrical(*steps: object, monitor: float = 0.0, seed: int = 0) -> Experiment:
    """A 10 Hz sine of 1.25 kV sampled at 2 kHz, its monitor's noise, and the exact current."""
    noise = monitor * np.random.default_rng(seed).standard_normal(TIME.size)
    volts = 1250.0 * (np.sin(OMEGA * TIME) + 1.0) + noise
    gain = R_L / (R_L + R_S)
    admittance = 1.0 / (R_S + R_L) + gain**2 * C * 1j * OMEGA / (1.0 + 1j * OMEGA * gain * R_S * C)
    current = 1250.0 * ((admittance * np.exp(1j * OMEGA * TIME)).imag + 1.0 / (R_S + R_L))
    row = ExperimentRow("a", "sine", "a.csv", "calibrate", "voltage", "current", {})
    raw = RawRecord(
        {"time": TIME, "voltage": volts, "current": current},
        {"time": "s", "voltage": "V", "current": "A"},
        "ab" * 32,
    )
    return prepare(row, raw, TUBE, list(steps))  # type: ignore[arg-type]


def bias(experiment: Experiment) -> tuple[float, float]:
    """Relative error of the R_S and C that fit the record best."""
    drive = experiment.excitation
    supply = Supply.of(drive.coordinate, drive.values, experiment.coordinate)

    def residuals(scaled: np.ndarray) -> np.ndarray:
        series, capacitance = scaled
        one = Circuit(np.array([1e3 * series]), np.array([R_L]), np.array([1e-7 * capacitance]))
        return 1e3 * (one.supplied(supply)[0] - experiment.response)

    fit = least_squares(residuals, [0.9, 1.8], diff_step=1e-4, bounds=([1e-3, 0.1], [20.0, 20.0]))
    return 1e3 * fit.x[0] / R_S - 1.0, 1e-7 * fit.x[1] / C - 1.0


def test_samples_joined_by_lines_are_wrong_about_the_resistance() -> None:
    assert bias(electrical(CROP))[0] < -0.5
    assert bias(electrical({"excitation_knots": {"tolerance": "2 V"}}, CROP))[0] > 0.5


def test_the_spline_is_not() -> None:
    series, capacitance = bias(electrical(SPLINE, CROP))
    assert abs(series) < 2e-3
    assert abs(capacitance) < 2e-6


def test_noise_of_the_monitor_is_no_current() -> None:
    found = np.array([bias(electrical(SPLINE, CROP, monitor=0.3, seed=s)) for s in range(3)])
    assert np.abs(found[:, 0]).max() < 6e-3
    assert np.abs(found[:, 1]).max() < 3e-5


@pytest.mark.parametrize("missing", [25, 100, 900])
def test_a_gap_is_no_smooth_curve(missing: int) -> None:
    """It would be one of kilovolts that were never there, or a matrix without an inverse."""
    kept = np.delete(np.arange(TIME.size), slice(500, 500 + missing))
    volts, unit = 1250.0 * np.sin(OMEGA * TIME[kept]), {"time": "s", "voltage": "V", "current": "A"}
    record = RawRecord(
        {"time": TIME[kept], "voltage": volts, "current": volts * 1e-6}, unit, "ab" * 32
    )
    row = ExperimentRow("a", "sine", "a.csv", "calibrate", "voltage", "current", {})
    gap = f"up to {(missing + 1) * 5e-4:.4g} s apart.* a piece of 0.01 s .*`from`"
    with pytest.raises(UserError, match=gap):
        prepare(row, record, TUBE, [SPLINE])


def test_what_comes_before_stays_as_measured() -> None:
    experiment = electrical(SPLINE)
    time = experiment.excitation.coordinate
    measured = 1250.0 * (np.sin(OMEGA * TIME) + 1.0)
    early = time < 0.05 - 1e-9
    np.testing.assert_array_equal(time[early], TIME[:100])
    np.testing.assert_array_equal(experiment.excitation.values[early], measured[:100])
    assert (time[~early][0], time[-1]) == pytest.approx((TIME[100], TIME[-1]))
    late = 1250.0 * (np.sin(OMEGA * time[~early]) + 1.0)
    np.testing.assert_allclose(experiment.excitation.values[~early], late, atol=0.05)
    assert np.all(np.diff(time) > 0.0)
    assert np.diff(time[~early]).max() <= 0.04e-3 * (1.0 + 1e-9)


@pytest.mark.parametrize("settings", [{"interval": "1 ms"}, {"from": "0.999 s"}])
def test_too_few_samples_per_piece(settings: dict[str, str]) -> None:
    step = {"excitation_spline": SPLINE["excitation_spline"] | settings}
    with pytest.raises(UserError, match="each needs 4, change `interval` or `from`"):
        electrical(step)
