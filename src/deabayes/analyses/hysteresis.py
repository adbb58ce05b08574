"""Displacement against voltage, cycle by cycle: the loop's area, its creep, when it is stable."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import Cycles, amplitude
from deabayes.analyses.loops import PHASES, Loops
from deabayes.analyses.summaries import band, interval, labels
from deabayes.experiment import Experiment, FloatArray

if TYPE_CHECKING:
    import xarray as xr

SYSTEMS = ("membrane", "minimum_energy_structure")
TITLE = "Hysteresis under alternating voltage"
CAPTION = (
    "Loop area of a cycle: −∮ u d|Φ|, positive where the displacement lags. Under a voltage of "
    "both signs the displacement moves at twice the voltage's frequency and the loop is a "
    "butterfly; under a biased one it is a single loop. Mean: of the displacement over the cycle; "
    "drift: its change per cycle since the cycle before, the creep; creep: from the first cycle to "
    "the last. A loop counts as stable from the first cycle after which its area changes by less "
    "than 10 % and its mean by less than 2 % of the cycle's peak-to-peak displacement, per cycle, "
    "to the end; what is before is the transition. Where the preparation averaged cycles, a "
    "group counts as its middle one."
)


def compute(context: StudyContext) -> Analysis:
    """Tables per cycle and per record; one data set of loops per displacement sine."""
    import pandas as pd

    cycles, stability, loops = [], [], {}
    for each in context.records("displacement", "sine"):
        found = Cycles.of(each)
        if found.starts.size == 0:
            continue
        measured = Loops.of(each, each.response, found)
        record = {"experiment": each.name, "frequency_Hz": found.frequency}
        bands = []
        for name, fitted in context.candidates.items():
            predicted = Loops.of(each, context.responses(name, each), found)
            middle = Loops.of(each, np.median(context.responses(name, each), axis=0), found)
            row = labels(name, fitted) | record
            cycles += [row | of_cycle(measured, predicted, k) for k in range(found.starts.size)]
            stability.append(row | {"measured_stable_from": measured.stable_from(),
                                    "predicted_stable_from": middle.stable_from()}
                             | creep(measured, predicted))  # fmt: skip
            bands.append(band(predicted.displacement))
        loops[each.name] = loop_curves(context, each, measured, np.array(bands))
    tables = {"hysteresis_cycles": cycles, "hysteresis_stability": stability}
    return Analysis({name: pd.DataFrame(rows) for name, rows in tables.items() if rows}, loops)


def of_cycle(measured: Loops, predicted: Loops, k: int) -> dict[str, object]:
    """One cycle's row: measured beside predicted, with the draws' interval."""
    row: dict[str, object] = {"cycle": int(measured.numbers[k])}
    kinds = (("area", "kVmm", 1.0), ("mean", "mm", 1e-3), ("peak_to_peak", "mm", 1e-3))
    for name, unit, scale in kinds:
        row[f"measured_{name}_{unit}"] = float(getattr(measured, name)[k]) / scale
        row |= interval(f"predicted_{name}", unit, getattr(predicted, name)[:, k] / scale)
    row["measured_drift_um"] = float(measured.drift[k]) / 1e-6
    return row | interval("predicted_drift", "um", predicted.drift[:, k] / 1e-6)


def creep(measured: Loops, predicted: Loops) -> dict[str, float]:
    """Rise of the cycles' mean from the first to the last, measured beside predicted."""
    found = {"measured_creep_um": float(measured.mean[-1] - measured.mean[0]) / 1e-6}
    of_draws = predicted.mean[:, -1] - predicted.mean[:, 0]
    return found | interval("predicted_creep", "um", of_draws / 1e-6)


def loop_curves(
    context: StudyContext, experiment: Experiment, measured: Loops, bands: FloatArray
) -> xr.Dataset:
    """Measured and predicted loops, bands (candidate, bound, cycle, phase)."""
    import xarray as xr

    names = list(context.candidates)
    loop = ("cycle", "phase")
    return xr.Dataset(
        {
            "voltage": (loop, measured.voltage, {"units": "V"}),
            "measured": (loop, measured.displacement, {"units": "m"}),
            "predicted": (("candidate", "bound", *loop), bands, {"units": "m"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "cycle": measured.numbers,
            "phase": np.linspace(0.0, 1.0, PHASES + 1),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "frequency_Hz": Cycles.of(experiment).frequency,
               "amplitude_kV": amplitude(experiment.excitation) / 1e3},
    )  # fmt: skip
