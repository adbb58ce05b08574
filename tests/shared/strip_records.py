"""Records of a made-up strip, and what preparation makes of them."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Quantity, Specimen
from deabayes.faults import Report
from deabayes.records.checks import checked
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare

STRIP = Specimen("strip", "tensile_strip", {"kind": "simulated"}, {})
LAGGING = Specimen(
    "strip", "tensile_strip", {"kind": "measured"}, {}, {"delay": Quantity(0.5, "s")}
)


def relaxation(interval: float = 0.02, end: float = 1000.0) -> RawRecord:
    """A 2 s ramp to 40 mm from t = 1 s, 0.8 mm overshoot, spring back in 0.2 s, then a hold."""
    time = np.arange(0.0, end, interval)
    displacement = np.interp(time, [0, 1, 3, 3.2, end], [0, 0, 0.0408, 0.04, 0.04])
    force = 1.0 / (1.0 + np.maximum(time - 3.0, 0.0)) * displacement / 0.04
    return raw(time, displacement, force)


def triangle() -> RawRecord:
    """80 mm up and down in 20 s; slack, with a negative force, once below 20 mm on the way back."""
    time = np.linspace(0.0, 20.0, 2001)
    displacement = 0.008 * np.minimum(time, 20.0 - time)
    back = np.where(displacement > 0.02, displacement - 0.02, -1e-4) * 10.0
    return raw(time, displacement, np.where(time > 10.0, back, displacement * 10.0))


def raw(time: FloatArray, displacement: FloatArray, force: FloatArray) -> RawRecord:
    columns = {"time": time, "displacement": displacement, "force": force}
    return RawRecord(columns, {"time": "s", "displacement": "m", "force": "N"}, "ab" * 32)


def prepared(
    record: RawRecord,
    *steps: object,
    protocol: str = "relaxation",
    specimen: Specimen = STRIP,
    bare_numbers: Report | None = None,
) -> Experiment:
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", "displacement", "force", {"note": "x"})
    return prepare(row, checked(row, record, specimen), specimen, list(steps), bare_numbers)  # type: ignore[arg-type]


def curve(
    stretch: FloatArray,
    stress: FloatArray,
    *steps: object,
    bare_numbers: Report | None = None,
    **metadata: object,
) -> Experiment:
    row = ExperimentRow(
        "a", "quasi_static", "a.csv", "calibrate", "stretch", "nominal_stress", metadata
    )  # type: ignore[arg-type]
    columns = {"stretch": stretch, "nominal_stress": stress}
    record = RawRecord(columns, {"stretch": "1", "nominal_stress": "Pa"}, "cd" * 32)
    return prepare(row, checked(row, record, STRIP), STRIP, list(steps), bare_numbers)  # type: ignore[arg-type]
