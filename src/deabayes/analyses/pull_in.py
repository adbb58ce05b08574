"""The voltage a membrane bears, and its steady stretch below it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses import membrane_paper as paper
from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import STEPS, amplitude, since_step
from deabayes.analyses.summaries import band, interval, labels
from deabayes.experiment import FloatArray
from deabayes.posteriors.fitted import Fitted

if TYPE_CHECKING:
    import xarray as xr

    from deabayes.systems.membrane.system import Membrane

SYSTEMS = ("membrane",)
TITLE = "Pull-in and steady stretch"
VOLTAGES = (2.0, 3.0, 4.0)
POINTS = 81
BEYOND = 1.25
"""The curves reach this many times the highest voltage of the records."""
CAPTION = (
    "Voltage at which the near equilibrium ends; where its branch folds that is pull-in, else it "
    "is where the stretch reaches the breakdown stretch or the springs lock up (fold: share of "
    "the draws that fold). Steady stretch: that of the near equilibrium under a constant voltage; "
    "beyond: share of the draws that have none. Medians with 5 to 95 % intervals. The paper prints "
    "neither: its parameters with stand-in Gent limits have the equilibria in the column "
    "“paper parameters”, and without Gent limits pull in at 3.75 kV."
)


def compute(context: StudyContext) -> Analysis:
    """Pull-in and steady stretch per candidate; steady stretch over the voltage."""
    import pandas as pd

    ends, steady = [], []
    for name, fitted in context.candidates.items():
        found = membrane(fitted).pull_in(fitted.draws)
        ends.append(
            labels(name, fitted) | interval("pull_in", "kV", found.voltage / 1e3)
            | interval("stretch_there", "", found.stretch)
            | {"fold_percent": 100.0 * float(np.mean(found.fold))}
        )  # fmt: skip
        steady += [labels(name, fitted) | steady_row(fitted, kilovolt) for kilovolt in VOLTAGES]
    tables = {"pull_in": pd.DataFrame(ends), "steady_stretch": pd.DataFrame(steady)}
    return Analysis(tables, {"steady_stretch": steady_curves(context)})


def membrane(fitted: Fitted) -> Membrane:
    """The candidate's forward model, known to be a membrane."""
    from deabayes.systems.membrane.system import Membrane

    assert isinstance(fitted.system, Membrane)
    return fitted.system


def steady_row(fitted: Fitted, kilovolt: float) -> dict[str, object]:
    """Steady stretch at one voltage, and the share of draws that lie beyond pull-in."""
    stretch = membrane(fitted).steady_stretch(fitted.draws, 1e3 * kilovolt)
    return {
        "voltage_kV": kilovolt,
        **interval("steady_stretch", "", stretch),
        "beyond_percent": 100.0 * float(np.mean(~np.isfinite(stretch))),
        "paper_parameters": paper.STEADY_STRETCH[kilovolt],
    }


def steady_curves(context: StudyContext) -> xr.Dataset:
    """Bands (candidate, bound, voltage) over the draws with a near equilibrium, and their share.

    With the stretch at the end of each step record, which is not the steady one yet.
    """
    import xarray as xr

    records = context.records("displacement", *STEPS)
    highest = max([amplitude(each.excitation) for each in records], default=4e3)
    grid = np.linspace(0.0, BEYOND * highest, POINTS)
    names = list(context.candidates)
    found = [steady_band(context.candidates[name], grid) for name in names]
    size, rest = (context.specimen.quantities[n].value for n in ("side_length", "prestretch"))
    last = [rest + float(each.response[-1]) / size for each in records]
    return xr.Dataset(
        {
            "stretch": (("candidate", "bound", "voltage"), np.array([b for b, _ in found])),
            "share": (("candidate", "voltage"), np.array([s for _, s in found])),
            "record_stretch": ("record", np.array(last)),
            "record_voltage": (
                "record", np.array([amplitude(each.excitation) for each in records])
            ),
            "record_duration": ("record", np.array([since_step(each)[-1] for each in records])),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "voltage": ("voltage", grid, {"units": "V"}),
            "record": [each.name for each in records],
        },
    )  # fmt: skip


def steady_band(fitted: Fitted, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Band (3, V) of the steady stretch and share (V,) of the draws that have one."""
    stretch = np.array([membrane(fitted).steady_stretch(fitted.draws, volts) for volts in grid])
    there = np.isfinite(stretch)
    bands = np.full((3, grid.size), np.nan)
    for k in np.flatnonzero(there.any(axis=1)):
        bands[:, k] = band(stretch[k, there[k], None])[:, 0]
    return bands, there.mean(axis=1)
