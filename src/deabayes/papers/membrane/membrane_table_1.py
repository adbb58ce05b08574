"""Table 1 of the membrane's paper: errors of the step and of the alternating response."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, error_interval, interval
from deabayes.papers.timing import STEPS, Cycles, amplitude, near, since_step

SYSTEMS = ("membrane",)
TITLE = "Errors by number of Maxwell units (Table 1)"
CAPTION = (
    "Errors of the posterior median curve, with the 5 to 95 % interval of the draws' own errors. "
    "Step: largest error later than 5 s after the step (e m) and within the first 5 s (overshoot), "
    "over the displacement's range from rest. Alternating: e rms and e m over the record's range. "
    "The paper's figures are of its own specimen; they stand beside the 4 kV step and the 0.05 Hz "
    "sine, the records whose parameters it lists."
)


def compute(context: StudyContext) -> Analysis:
    """Return one row per candidate and displacement record."""
    steps = [
        first
        | {"experiment": record.name, "role": record.role}
        | step_errors(record, curves)
        | printed_step(record, first["order"])
        for first, record, curves in context.predicted(context.records("displacement", *STEPS))
    ]
    sines = [
        first
        | {"experiment": record.name, "role": record.role}
        | sine_errors(record, curves)
        | printed_sine(record, first["order"])
        for first, record, curves in context.predicted(context.records("displacement", "sine"))
    ]
    return Analysis.of_rows({"table_1_step": steps, "table_1_alternating": sines})


def step_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_m after the overshoot and within it, in percent of the range from rest.

    e_m = max|y - f| / (max y - min y), equations.md section 4. The range of y includes zero, the
    value at rest, because the preparation may hide it.
    """
    y, late = experiment.response, since_step(experiment) > paper.OVERSHOOT
    size = np.ptp(np.append(y, 0.0))
    return {
        **_largest("e_m", y[late], curves[:, late], size),
        **_largest("overshoot", y[~late], curves[:, ~late], size),
    }


def sine_errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_rms and e_m of the whole record in percent of its range (equations.md section 4)."""
    y, size = experiment.response, experiment.response_range

    def e_rms(predicted: FloatArray) -> FloatArray:
        return 100.0 * np.sqrt(np.mean((y - predicted) ** 2, axis=-1)) / size

    return error_interval("e_rms", curves, e_rms) | _largest("e_m", y, curves, size)


def _largest(name: str, y: FloatArray, curves: FloatArray, size: float) -> dict[str, float]:
    if y.size == 0:
        return interval(name, "percent", [])
    return error_interval(name, curves, lambda c: 100.0 * np.max(np.abs(y - c), axis=-1) / size)


def printed_step(experiment: Experiment, order: object) -> dict[str, float]:
    """Errors of the step in the paper's Table 1; NaN for another record or order."""
    if not near(amplitude(experiment.excitation) / 1e3, paper.STEP_VOLTAGE):
        order = None
    return {
        "paper_e_m_percent": paper.STEP_E_M.get(order, np.nan),
        "paper_overshoot_percent": paper.STEP_OVERSHOOT.get(order, np.nan),
    }


def printed_sine(experiment: Experiment, order: object) -> dict[str, float]:
    """Error of the sine in the paper's Table 1; NaN for another record or order."""
    if not near(Cycles.of(experiment).frequency, paper.SINE_FREQUENCY):
        order = None
    return {"paper_e_rms_percent": paper.ALTERNATING_E_RMS.get(order, np.nan)}
