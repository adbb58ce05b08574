"""Table 2 of the membrane's paper: the largest error of the area."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, interval, labels
from deabayes.papers.timing import STEPS, amplitude, since_step

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
    import pandas as pd

    rows = [
        labels(name, fitted)
        | {"experiment": each.name, "voltage_kV": amplitude(each.excitation) / 1e3}
        | area_errors(each, context.responses(name, each))
        | _printed(each)
        for name, fitted in context.candidates.items()
        for each in context.records("area", *STEPS)
    ]
    return Analysis({"table_2_area": pd.DataFrame(rows)} if rows else {})


def area_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """max |(S_measured - S_estimated)/S_measured| in percent (Error_m_e of the paper's Table 2)."""
    relative = 100.0 * np.abs(1.0 - curves / experiment.response)
    median = 100.0 * np.abs(1.0 - np.median(curves, axis=0) / experiment.response)
    late = since_step(experiment) > paper.OVERSHOOT
    every = np.ones_like(late)
    found: dict[str, float] = {}
    for name, part in (("after_overshoot", late), ("overall", every)):
        if part.any():
            largest = relative[:, part].max(axis=1)
            found |= interval(name, "percent", largest, float(median[part].max()))
    return found


def _printed(experiment: Experiment) -> dict[str, float]:
    volts = amplitude(experiment.excitation) / 1e3
    printed = [each for kv, each in paper.AREA.items() if paper.near(volts, kv)]
    largest, camera = printed[0] if printed else (np.nan, np.nan)
    return {"paper_percent": largest, "paper_camera_percent": camera}
