"""Table 1 of the membrane's paper: errors of the step and of the alternating response."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, interval, labels
from deabayes.papers.timing import STEPS, Cycles, amplitude, since_step

SYSTEMS = ("membrane",)
TITLE = "Errors by number of Maxwell units (Table 1)"
CAPTION = (
    "Errors of the posterior median curve, with the 5 to 95 % interval of the draws' own errors. "
    "Step: largest error later than 5 s after the step (e m) and within the first 5 s (overshoot), "
    "over the displacement's range from rest. Alternating: e rms and e m over the record's range. "
    "The paper's figures were found on its own specimen; they stand beside the 4 kV step and the "
    "0.05 Hz sine, the records whose parameters it lists."
)


def compute(context: StudyContext) -> Analysis:
    """Return one row per candidate and displacement record."""
    import pandas as pd

    steps, sines = [], []
    for name, fitted in context.candidates.items():
        order = fitted.system.order
        for each in context.records("displacement", *STEPS):
            curves = context.responses(name, each)
            steps.append(labels(name, fitted) | _record(each) | step_errors(each, curves)
                         | _printed_step(each, order))  # fmt: skip
        for each in context.records("displacement", "sine"):
            curves = context.responses(name, each)
            sines.append(labels(name, fitted) | _record(each) | sine_errors(each, curves)
                         | _printed_sine(each, order))  # fmt: skip
    tables = {"table_1_step": steps, "table_1_alternating": sines}
    return Analysis({name: pd.DataFrame(rows) for name, rows in tables.items() if rows})


def step_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_m after the overshoot and within it, in percent of the range from rest.

    e_m = max|y - f| / (max y - min y), equations.md section 4. The range of y includes zero, the
    value at rest, because the preparation may hide it.
    """
    reading = np.append(experiment.response, 0.0)
    late = since_step(experiment) > paper.OVERSHOOT
    found: dict[str, float] = {}
    for name, part in (("e_m", late), ("overshoot", ~late)):
        found |= _largest(name, experiment.response[part], curves[:, part], np.ptp(reading))
    return found


def sine_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_rms and e_m of the whole record in percent of its range (equations.md section 4)."""
    observed, size = experiment.response, experiment.response_range
    median = np.median(curves, axis=0)

    def e_rms(predicted: FloatArray) -> FloatArray:
        return 100.0 * np.sqrt(np.mean((observed - predicted) ** 2, axis=-1)) / size

    found = interval("e_rms", "percent", e_rms(curves), float(e_rms(median)))
    return found | _largest("e_m", observed, curves, size)


def _largest(name: str, observed: FloatArray, curves: FloatArray, size: float) -> dict[str, float]:
    if observed.size == 0:
        return interval(name, "percent", np.array([]))
    median = np.median(curves, axis=0)
    of_draws = 100.0 * np.max(np.abs(observed - curves), axis=-1) / size
    return interval(name, "percent", of_draws, 100.0 * np.max(np.abs(observed - median)) / size)


def _record(experiment: Experiment) -> dict[str, object]:
    return {"experiment": experiment.name, "role": experiment.role}


def _printed_step(experiment: Experiment, order: int) -> dict[str, float]:
    printed = paper.near(amplitude(experiment.excitation) / 1e3, paper.STEP_VOLTAGE)
    return {
        "paper_e_m_percent": paper.STEP_E_M.get(order, np.nan) if printed else np.nan,
        "paper_overshoot_percent": paper.STEP_OVERSHOOT.get(order, np.nan) if printed else np.nan,
    }


def _printed_sine(experiment: Experiment, order: int) -> dict[str, float]:
    printed = paper.near(Cycles.of(experiment).frequency, paper.SINE_FREQUENCY)
    return {
        "paper_e_rms_percent": paper.ALTERNATING_E_RMS.get(order, np.nan) if printed else np.nan
    }
