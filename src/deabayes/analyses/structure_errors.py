"""Table 5 of the minimum-energy structure's paper: e_rms by frequency and voltage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.analyses import structure_paper as paper
from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import Cycles
from deabayes.analyses.summaries import beside, interval, labels
from deabayes.experiment import Experiment, FloatArray
from deabayes.prediction.errors import relative_rms_error

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Errors of the sines (Table 5)"
PERCENT = 100.0
CAPTION = (
    "e_rms (26) in per cent of the record's range: of the posterior median curve, with the 5 to "
    "95 % interval of the draws' own. The whole record as prepared, where the cycles of the "
    "transition weigh more than in the raw samples, and the second half of its time alone, where "
    "the response is stable. Role: whether the record was fitted. The paper's figures were found "
    "on its own specimen; it tuned on 1, 5 and 10 Hz at 5 kV, as is fitted here."
)


def compute(context: StudyContext) -> Analysis:
    """One row per candidate and frequency, the voltages side by side."""
    import pandas as pd

    records = context.records("displacement", "sine")
    rows = [
        labels(name, fitted)
        | {"frequency_Hz": round(Cycles.of(each).frequency, 3)}
        | {"voltage_kV": paper.kilovolts(each)}
        | errors(each, context.responses(name, each))
        for name, fitted in context.candidates.items()
        for each in records
    ]
    return Analysis({"table_5_errors": pd.DataFrame(beside(rows, "kV"))} if rows else {})


def errors(experiment: Experiment, curves: FloatArray) -> dict[str, object]:
    """e_rms of the whole record and of the second half of its time, and the printed figure."""
    start = experiment.excitation.onset
    late = experiment.coordinate > 0.5 * (start + experiment.coordinate[-1])
    found: dict[str, object] = {"role": experiment.role}
    for name, part in (("e_rms", np.ones_like(late)), ("e_rms_late", late)):
        found |= _e_rms(name, experiment, curves, part)
    printed = paper.e_rms(paper.kilovolts(experiment), Cycles.of(experiment).frequency)
    return found | {"paper_e_rms_percent": printed}


def _e_rms(
    name: str, experiment: Experiment, curves: FloatArray, part: NDArray[np.bool_]
) -> dict[str, float]:
    observed, middle = experiment.response[part], np.median(curves, axis=0)[part]
    scale = PERCENT * np.ptp(observed) / experiment.response_range
    of_draws = scale * relative_rms_error(observed, curves[:, part])
    return interval(name, "percent", of_draws, scale * float(relative_rms_error(observed, middle)))
