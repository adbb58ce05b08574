"""Relative error over time, as in the membrane paper's Fig. 13."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import amplitude, since_step
from deabayes.analyses.summaries import band
from deabayes.experiment import Experiment

if TYPE_CHECKING:
    import xarray as xr

SYSTEMS = ("membrane",)
TITLE = "Error against time (Fig. 13)"
CAPTION = (
    "Measured minus predicted displacement over the displacement's range from rest: the posterior "
    "median and the 5 to 95 % interval of the draws, against the time since the voltage came on."
)


def compute(context: StudyContext) -> Analysis:
    """One data set per displacement record."""
    records = [e for e in context.experiments if e.response_name == "displacement"]
    return Analysis(curves={each.name: error_curves(context, each) for each in records})


def error_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """(y - f)/(max y - min y) in percent: band (candidate, bound, time).

    The zero at rest is counted among the y.
    """
    import xarray as xr

    size = np.ptp(np.append(experiment.response, 0.0))
    names = list(context.candidates)
    errors = [
        band(100.0 * (experiment.response - context.responses(name, experiment)) / size)
        for name in names
    ]
    return xr.Dataset(
        {"error": (("candidate", "bound", "time"), np.array(errors), {"units": "%"})},
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "time": ("time", since_step(experiment), {"units": "s"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "protocol": experiment.protocol,
               "amplitude_kV": amplitude(experiment.excitation) / 1e3},
    )  # fmt: skip
