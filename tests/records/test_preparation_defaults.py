"""The usual preparation keeps amplitudes and ringing."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.records.checks import checked
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import REGISTRY, prepare
from deabayes.records.preparation.average import width_for
from deabayes.records.preparation.defaults import _every

FILM = Specimen("film", "membrane", {"kind": "simulated"}, {})


def recorded(
    time: FloatArray, volts: FloatArray, moved: FloatArray, *steps: object, protocol: str = "sine"
) -> Experiment:
    columns = {"time": time, "voltage": volts, "displacement": moved}
    raw = RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", "voltage", "displacement", {})
    return prepare(row, checked(row, raw, FILM), FILM, list(steps) or None)  # type: ignore[arg-type]


def kept(experiment: Experiment, frequency: float, lag: float = 0.3) -> float:
    """Share of the amplitude of 1 + sin(2 pi f t - lag) that the points have."""
    clean = np.sin(2.0 * np.pi * frequency * experiment.coordinate - lag)
    basis = np.column_stack([np.ones_like(clean), clean])
    return float(np.linalg.lstsq(basis, experiment.response, rcond=None)[0][1])


def sine(
    frequency: float, cycles: float, rate: float, multiple: int, *steps: object, modulated=False
) -> Experiment:
    time = np.arange(0.0, cycles / frequency, 1.0 / rate)
    volts = 2e3 * np.sin(2.0 * np.pi * frequency * time)
    if modulated:
        volts *= 1.0 + 0.5 * time / time[-1]
    moved = 1.0 + np.sin(2.0 * np.pi * multiple * frequency * time - 0.3)
    return recorded(time, volts, moved, *steps)


@pytest.mark.parametrize("multiple", [1, 2])
@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize(
    ("frequency", "cycles", "rate"),
    [
        (1.0, 2.3, 1e3), (1.0, 4.9, 1e3), (1.0, 6.0, 1e3), (0.05, 30.0, 80.0), (1.0, 50.0, 1e3),
        (10.0, 500.0, 1e3), (10.0, 500.0, 450.0), (10.0, 200.0, 250.0), (3.0, 100.0, 1234.5),
    ],
)  # fmt: skip
def test_a_sine_keeps_its_amplitude(
    frequency: float, cycles: float, rate: float, modulated: bool, multiple: int
) -> None:
    experiment = sine(frequency, cycles, rate, multiple, modulated=modulated)
    allowed = 5e-3 if rate / frequency < 80.0 else 1.2e-3
    assert 1.0 - allowed < kept(experiment, multiple * frequency) < 1.0 + 1e-6
    assert 190 <= experiment.coordinate.size <= 560
    assert not [each for each in experiment.warnings if "flatten" in each]
    assert {str(step["step"]) for step in experiment.steps} <= set(REGISTRY)


def test_many_alike_cycles_are_averaged_at_equal_phase() -> None:
    names = [step["step"] for step in sine(10.0, 500.0, 1e3, 2).steps]
    assert names == ["cycles", "excitation_knots"]
    names = [step["step"] for step in sine(10.0, 500.0, 1e3, 2, modulated=True).steps]
    assert names == ["excitation_knots", "average", "decimate"]


@pytest.mark.parametrize("share", [1 / 80, 1 / 50, 0.01, 0.25, 1 / 3])
@pytest.mark.parametrize("least", [10.0, 80.0, 100.0, 160.0])
def test_thinned_bins_do_not_stand_at_the_same_few_phases(share: float, least: float) -> None:
    every = _every(least, share)
    assert 0.7 * least <= every <= least + 1.0
    phases = np.unique(np.round((every * share * np.arange(400)) % 1.0, 6) % 1.0)
    assert phases.size >= min(round(1.0 / share), 5)


def test_a_bin_of_the_width_for_a_share_takes_that_off_a_sine() -> None:
    time = np.linspace(-0.5, 0.5, 100_001) * width_for(1e-3, 3.0)
    assert 1.0 - np.cos(6.0 * np.pi * time).mean() == pytest.approx(1e-3, rel=1e-2)


def ringing_step(
    span: float, period: float, decay: float, noise: float = 0.0, hum: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A step at 20 ms: creep and a decaying oscillation; time, volts, response, without noise."""
    time = np.arange(0.0, span, 2e-4)
    since = np.maximum(time - 0.02, 0.0)
    creep = 1.0 + 0.2 * (1.0 - np.exp(-since / (0.3 * span)))
    clean = creep - np.exp(-since / decay) * np.cos(2.0 * np.pi * since / period)
    clean = np.where(time < 0.02, 0.0, clean)
    rough = noise * np.random.default_rng(4).standard_normal(time.size)
    rough += hum * np.sin(2.0 * np.pi * 50.0 * time)
    return time, np.where(time < 0.02, 0.0, 2e3), clean + rough, clean


@pytest.mark.parametrize("protocol", ["creep", "step"])
@pytest.mark.parametrize("noise", [0.0, 2e-3, 2e-2])
def test_a_ringing_response_keeps_its_ringing(protocol: str, noise: float) -> None:
    time, volts, moved, clean = ringing_step(0.5, 0.016, 0.05, noise)
    experiment = recorded(time, volts, moved, protocol=protocol)
    away = np.abs(experiment.response - np.interp(experiment.coordinate, time, clean))
    assert away.max() < 2e-3 * np.ptp(clean) + 4.0 * noise
    assert 250 < experiment.coordinate.size < 450 and not experiment.warnings


def test_a_long_record_that_rings_keeps_the_usual_bins() -> None:
    time, volts, moved, _ = ringing_step(20.0, 0.016, 0.05)
    experiment = recorded(time, volts, moved, protocol="creep")
    assert not experiment.warnings and "widest" not in str(experiment.steps)


@pytest.mark.parametrize("hum", [0.0, 0.05])
def test_creep_noise_and_hum_are_no_ringing(hum: float) -> None:
    time, volts, moved, _ = ringing_step(2.0, 1e9, 0.1, 0.01, hum)
    experiment = recorded(time, volts, moved, protocol="creep")
    assert not experiment.warnings and "widest" not in str(experiment.steps)


def test_what_is_switched_on_and_off_does_not_ring() -> None:
    """Twice, and then it rests: the response turns as a decaying oscillation would."""
    time = np.arange(0.0, 60.0, 1e-2)
    on = ((time % 10.0) < 5.0) & (time < 20.0)
    late = np.where(time < 20.0, time % 5.0, time - 15.0)
    moved = np.where(on, 1.0 - np.exp(-late), np.exp(-late))
    experiment = recorded(time, np.where(on, 2e3, 0.0), moved, protocol="step")
    (warning,) = experiment.warnings
    assert "begins with 2 kV" in warning and "widest" not in str(experiment.steps)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_voltage_on_from_the_start_is_a_step_there(noise: float) -> None:
    """A monitor's noise makes no knots of it, nor corners between which nothing could ring."""
    time, _, moved, _ = ringing_step(0.5, 0.016, 0.05)
    on = time >= 0.02
    monitor = 2e3 + noise * np.random.default_rng(6).standard_normal(on.sum())
    experiment = recorded(time[on], monitor, moved[on], protocol="creep")
    (warning,) = experiment.warnings
    assert "so the step is taken to happen at the first sample" in warning
    assert ("voltage is constant but for 2" in warning) == (noise > 0.0)
    assert experiment.excitation.values.size == 2
    assert "widest" in str(experiment.steps)
    uniform = {"average": {"grid": "uniform", "points": 100}}
    assert recorded(time[on], monitor, moved[on], uniform, protocol="creep").response.size == 100


@pytest.mark.parametrize("shape", ["sag", "step"])
def test_a_small_change_of_a_high_voltage_keeps_its_knots(shape: str) -> None:
    time = np.arange(0.0, 10.0, 1e-2)
    change = -np.expm1(-time) if shape == "sag" else np.where(time > 4.0, 1.0, 0.0)
    noise = 0.3 * np.random.default_rng(6).standard_normal(time.size)
    experiment = recorded(time, 2e3 + 15.0 * change + noise, 1.0 + 0.1 * time, protocol="creep")
    away = experiment.excitation.at(time) - 2e3 - 15.0 * change
    assert np.sqrt(np.mean(away**2)) < 0.5
    assert not [text for text in experiment.warnings if "happen at the first" in text]


def test_many_knots_are_put_down_to_noise_only_where_there_is_some() -> None:
    knots = {"excitation_knots": {}}
    time = np.arange(0.0, 100.0, 1e-3)
    clean = 2e3 * np.sin(20.0 * np.pi * time)
    (warning,) = recorded(time, clean, clean, knots).warnings
    assert "turns that often" in warning
    noisy = clean + 10.0 * np.random.default_rng(5).standard_normal(time.size)
    (warning,) = recorded(time, noisy, clean, knots).warnings
    assert "its noise exceeds the tolerance" in warning
