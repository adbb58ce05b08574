"""A sample that stands out alone is no ringing, and is named as what it is."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.records.channels import glitches, least_swing, single_samples, without_single_samples
from deabayes.records.checks import checked
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare

TIME = np.arange(0.0, 60.0, 0.2)
VOLTS = np.where(TIME < 5.0, 0.0, 3e3)


def prepared(volts: FloatArray, moved: FloatArray, protocol: str = "creep") -> Experiment:
    """A membrane's record after the usual preparation."""
    columns = {"time": TIME, "voltage": volts, "displacement": moved}
    raw = RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", "voltage", "displacement", {})
    film = Specimen("film", "membrane", {"kind": "simulated"}, {})
    return prepare(row, checked(row, raw, film), film)


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


@pytest.mark.parametrize("value", [0.0, 4e4, -4e4])
@pytest.mark.parametrize("protocol", ["creep", "step", "sweep"])
def test_a_glitch_of_the_voltages_monitor_is_named(protocol: str, value: float) -> None:
    volts = np.where(np.abs(TIME - 30.0) < 0.05, value, VOLTS)
    (warning,) = prepared(volts, crept(), protocol).warnings
    shown = {0.0: "0 V", 4e4: "40 kV", -4e4: "-40 kV"}[value]
    assert warning == (
        f"a.csv (a), column voltage: the single sample at 30 s, {shown} before 3 kV, stands out; "
        "if it was not driven so, correct the row in the file, or remove it"
    )


def shapes() -> dict[str, FloatArray]:
    """What excitations may look like [V], 2000 samples each."""
    rng, place = np.random.default_rng(6), np.arange(2000)
    levels, times = rng.uniform(0.0, 4e3, 2000), rng.integers(1, 20, 2000)
    return {
        "step with an overshoot": np.where(place < 200, 0.0, 4e3) + 300.0 * (place == 200),
        "triangle": 4e3 * np.abs((place / 100.0) % 2.0 - 1.0),
        "triangle of few samples": 4e3 * np.abs((place / 4.0) % 2.0 - 1.0),
        "sine": 2e3 + 2e3 * np.sin(0.05 * place),
        "sine of few samples": 2e3 + 2e3 * np.sin(1.3 * place),
        "small sine on a bias": 3e3 + 20.0 * np.sin(0.05 * place),
        "square wave": 4e3 * ((place // 50) % 2),
        "pulses of two samples": 4e3 * (place % 100 < 2),
        "random levels": levels,
        "random levels, held": np.repeat(levels, 5)[:2000],
        "random levels, held for various times": np.repeat(levels, times)[:2000],
        "two levels": 4e3 * rng.integers(0, 2, 2000),
        "on from the start": np.full(2000, 2e3),
    }  # fmt: skip


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("lag", [2.0, 50.0])
@pytest.mark.parametrize("shape", shapes())
def test_what_is_driven_is_no_glitch(shape: str, lag: float, noise: float) -> None:
    volts, rng = shapes()[shape], np.random.default_rng(7)
    followed = np.convolve(volts**2, np.exp(-np.arange(500.0) / lag))[:2000]
    response = followed + 1e-3 * np.ptp(followed) * rng.standard_normal(2000)
    assert glitches(volts + noise * rng.standard_normal(2000), response).size == 0


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
