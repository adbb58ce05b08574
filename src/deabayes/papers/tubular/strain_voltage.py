"""Response to a sine against time and against voltage: Fig. 9 of the tubular paper."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import bands, panels, style
from deabayes.figures.record import Record
from deabayes.figures.results import CandidateResults
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import display_unit

SCOPE = "candidate"
SYSTEMS = ("tubular",)
TITLE = "Strain under a sine"
CAPTION = (
    "Left: the first cycles, from rest. Middle: the last cycles. Right: the last cycle against "
    "the voltage. Measured points, the posterior median and the three 90 % bands."
)
CYCLES = 2.5
MOTIONS = ("strain", "displacement")


def draw(results: CandidateResults) -> list[Figure]:
    """Return one sheet per sine record of strain or displacement."""
    return [
        _sheet(Record(prediction))
        for prediction in results.predictions.values()
        if prediction.attrs["protocol"] == "sine" and prediction.attrs["response_name"] in MOTIONS
    ]


def _sheet(record: Record) -> Figure:
    figure, ((first, last, loop),) = panels.grid(1, 3, 2.2 + 0.4)
    time = record.prediction["coordinate"].values
    period = usual_period(passes(time, record.prediction["excitation"].values))
    period = period if np.isfinite(period) else float(np.ptp(time))
    early = time <= time[0] + CYCLES * period
    late = time >= time[-1] - CYCLES * period
    cycle = time >= time[-1] - period
    unit = display_unit("s", time)
    for ax, part, words in ((first, early, "from rest"), (last, late, "last cycles")):
        _curve(ax, record, time[part] / unit.factor, part)
        ax.set_xlabel(f"time{unit.suffix}, {words}")
    volts = record.prediction["excitation"].values
    volt = display_unit("V", volts)
    _curve(loop, record, volts[cycle] / volt.factor, cycle)
    loop.set_xlabel(f"voltage{volt.suffix}, last cycle")
    first.set_ylabel(record.label)
    panels.title(first, record, whole=True)
    panels.legend_below(figure, bands.handles())
    return figure


def _curve(ax: Axes, record: Record, x: np.ndarray, part: np.ndarray) -> None:
    """Draw bands, points and median of a part of the record against time or voltage."""
    bands.fill(ax, x, {name: record.whole_band(name)[:, part] for name in style.BANDS})
    panels.draw_observed(ax, x, record.whole("observed")[part])
    ax.plot(x, record.whole("median")[part], color=style.BLUE, linewidth=1.1, zorder=4)
