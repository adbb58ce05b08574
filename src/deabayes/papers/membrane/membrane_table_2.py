"""Table 2 of the membrane's paper: the largest error of the area."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, error_interval
from deabayes.papers.timing import STEPS, amplitude, near, since_step

SYSTEMS = ("membrane",)
TITLE = "Largest error of the area (Table 2)"
CAPTION = (
    "Largest |S measured − S estimated| / S measured of the posterior median curve, with the 5 to "
    "95 % interval of the draws' own, later than 5 s after the step and over the whole record. The "
    "camera's noise is part of it. The paper does not say which order its figures are of; its "
    "camera column is the error it gives for the camera."
)


def compute(context: StudyContext) -> Analysis:
    """Return one row per candidate and area record."""
    rows = []
    for first, record, curves in context.predicted(context.records("area", *STEPS)):
        volts = amplitude(record.excitation) / 1e3
        printed = [values for kilovolts, values in paper.AREA.items() if near(volts, kilovolts)]
        largest, camera = printed[0] if printed else (np.nan, np.nan)
        rows.append(
            first
            | {"experiment": record.name, "voltage_kV": volts}
            | area_errors(record, curves)
            | {"paper_percent": largest, "paper_camera_percent": camera}
        )
    return Analysis.of_rows({"table_2_area": rows})


def area_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """max |(S_measured - S_estimated)/S_measured| in percent (Error_m_e of the paper's Table 2)."""
    late = since_step(experiment) > paper.OVERSHOOT
    largest = _largest("overall", experiment.response, curves)
    if not late.any():
        return largest
    return _largest("after_overshoot", experiment.response[late], curves[:, late]) | largest


def _largest(name: str, y: FloatArray, curves: FloatArray) -> dict[str, float]:
    return error_interval(name, curves, lambda c: (100.0 * np.abs(1.0 - c / y)).max(axis=-1))
