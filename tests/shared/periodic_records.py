"""Long periodic records whose period, drift and noise are known, and `cycles` of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare

FILM = Specimen("film", "tubular", {"kind": "simulated"}, {})
MONITOR = 0.3
Signal = Callable[[FloatArray], FloatArray]


def biased(frequency: float) -> Signal:
    """0.5 to 5 kV from the trough: never zero while it is on."""
    return lambda time: 2250.0 * np.sin(2.0 * np.pi * frequency * time - np.pi / 2.0) + 2750.0


def unbiased(frequency: float) -> Signal:
    return lambda time: 2500.0 * np.sin(2.0 * np.pi * frequency * time)


def periodic(time: FloatArray, frequency: float) -> FloatArray:
    """A response of unit amplitude with a second harmonic."""
    angle = 2.0 * np.pi * frequency * time
    return np.sin(angle - 0.7) + 0.2 * np.cos(2.0 * angle)


def record(
    frequency: float = 2.0,
    *,
    count: float = 50.0,
    rest: float = 0.0,
    after: float = 0.0,
    interval: float = 1e-3,
    volts: Signal | None = None,
    monitor: float = MONITOR,
    drift: float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
) -> RawRecord:
    """`count` periods of voltage and response between two rests; `drift` per second."""
    rng = np.random.default_rng(seed)
    time = interval * np.arange(round((rest + count / frequency + after) / interval))
    since = time - rest
    on = (since > -1e-9) & (since < count / frequency)
    voltage = np.where(on, (volts or biased(frequency))(since), 0.0)
    response = np.where(on, periodic(since, frequency), 0.0) + drift * time
    columns = {
        "time": time,
        "voltage": voltage + monitor * rng.standard_normal(time.size),
        "displacement": response + noise * rng.standard_normal(time.size),
    }
    return RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)


def reduced(
    raw: RawRecord, *before: object, stated: object = None, then: str = "", **settings: object
) -> Experiment:
    """The record after the steps `before`, `cycles` with its settings, and `then`."""
    row = ExperimentRow("a", "sine", "a.csv", "calibrate", "voltage", "displacement",
                        {} if stated is None else {"frequency_Hz": stated})  # type: ignore[dict-item]  # fmt: skip
    after = [then] if then else []
    return prepare(row, raw, FILM, [*before, {"cycles": settings}, *after])  # type: ignore[list-item]


def said(experiment: Experiment) -> dict[str, object]:
    return dict(experiment.steps[-1])


def warned(experiment: Experiment) -> list[str]:
    """What the steps warn of, and not that the voltage is on from the first sample."""
    return [warning for warning in experiment.warnings if "at the first sample" not in warning]
