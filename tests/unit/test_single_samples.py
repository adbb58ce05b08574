"""A sample that stands out alone is no ringing, and is named as what it is."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.preparation import prepare
from deabayes.reading.raw import ExperimentRow, RawRecord
from deabayes.reading.single_samples import least_swing, single_samples, without_single_samples

TIME = np.arange(0.0, 60.0, 0.2)
VOLTS = np.where(TIME < 5.0, 0.0, 3e3)


def prepared(volts: FloatArray, moved: FloatArray, protocol: str = "creep") -> Experiment:
    """A membrane's record after the usual preparation."""
    columns = {"time": TIME, "voltage": volts, "displacement": moved}
    raw = RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", "voltage", "displacement", {})
    return prepare(row, raw, Specimen("film", "membrane", {"kind": "simulated"}, {}))


def crept(*glitches: tuple[float, float]) -> FloatArray:
    """Creep [m] from 5 s on with noise of 10 um, and glitches (time, value)."""
    since = np.maximum(TIME - 5.0, 0.0)
    moved = np.where(TIME < 5.0, 0.0, 1e-3 + 3e-4 * (1.0 - np.exp(-since / 20.0)))
    moved = moved + 1e-5 * np.random.default_rng(5).standard_normal(TIME.size)
    for time, value in glitches:
        moved[np.argmin(np.abs(TIME - time))] = value
    return moved


@pytest.mark.parametrize("value", [5e-4, 3e-3, -1e-2])
@pytest.mark.parametrize("at", [3.0, 5.2, 6.0, 30.0, 59.6])
def test_a_single_sample_is_no_ringing(at: float, value: float) -> None:
    experiment = prepared(VOLTS, crept((at, value)))
    (warning,) = experiment.warnings
    assert f"column displacement: the single sample at {at:g} s, " in warning
    assert "stands out; if the sensor failed there" in warning
    assert "widest" not in str(experiment.steps)


def test_several_are_counted() -> None:
    (warning,) = prepared(VOLTS, crept((20.0, 0.0), (40.0, 0.0)), "step").warnings
    assert "at 20 s, 0 m before" in warning and "stands out (and 1 more)" in warning


def test_creep_noise_and_a_pulse_are_no_single_samples() -> None:
    assert not prepared(VOLTS, crept()).warnings
    pulse = np.where(np.abs(TIME - 30.0) < 0.05, 0.0, VOLTS)
    assert not prepared(pulse, crept((30.0, 2e-4)), "step").warnings


@pytest.mark.parametrize("period", [2.0, 2.5, 3.0, 4.0, 5.0, 8.0, 12.0, 30.0])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("periods", [1.0, 5.0])
def test_ringing_is_no_single_sample(period: float, phase: float, periods: float) -> None:
    since = np.maximum(np.arange(200.0) - 20.0 + phase, 0.0)
    swings = np.exp(-since / (periods * period)) * np.cos(2.0 * np.pi * since / period)
    response = np.where(since > 0.0, 1.0 - swings, 0.0)
    swing = least_swing(response)
    assert single_samples(response, swing).size == 0
    np.testing.assert_array_equal(without_single_samples(response, swing), response)
