"""Every record before and after preparation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import DisplayUnit, display_unit, plain
from deabayes.records.preparation.prepared import RawOverview, read_overview, read_prepared

SCOPE = "study"
TITLE = "Records before and after preparation"
CAPTION = (
    "Grey: the raw record, thinned with its extremes kept. Orange crosses: samples hidden from the "
    "likelihood. Blue: the points the likelihood sees, each the mean of the raw samples it stands "
    "for. Below each record the excitation as recorded (grey) and the polyline that drives the "
    "model (red, knots as squares). A record that ends in a long hold is drawn against the time "
    "since its ramp ended, on a scale linear up to the ramp's length and logarithmic beyond."
)
RECORDS_PER_SHEET = 6
LONG_HOLD = 10.0
MARKED_KNOTS = 60
HIDDEN, POINTS = "hidden from the likelihood", "points of the likelihood"


@dataclass(frozen=True)
class PreparedRecord:
    """A prepared experiment and the overview of its raw record, both from one file."""

    experiment: Experiment
    raw: RawOverview | None

    @classmethod
    def read(cls, path: Path) -> PreparedRecord:
        return cls(read_prepared(path), read_overview(path))

    @property
    def excitation_unit(self) -> DisplayUnit:
        excitation = self.experiment.excitation
        return display_unit(excitation.unit, excitation.values, excitation.name)

    @property
    def response_unit(self) -> DisplayUnit:
        return display_unit(
            self.experiment.response_unit, self.experiment.response, self.experiment.response_name
        )

    @property
    def coordinate_unit(self) -> DisplayUnit:
        """Display unit of the coordinate."""
        unit, values = self.experiment.coordinate_unit, self.experiment.coordinate
        return display_unit(unit, values, self.experiment.coordinate_name)

    @property
    def is_curve(self) -> bool:
        """Whether the coordinate is the excitation, which then needs no panel of its own."""
        return self.experiment.coordinate_name == self.experiment.excitation.name

    @property
    def is_loop(self) -> bool:
        """Whether the response is drawn against the excitation, as for protocol `load_unload`."""
        return self.experiment.protocol == "load_unload"

    def turn(self) -> float | None:
        """Coordinate at which the final long hold begins; None if the record has none."""
        if self.is_curve:
            return None
        knots, values = self.experiment.excitation.coordinate, self.experiment.excitation.values
        far = np.abs(values - values[-1]) > 0.05 * max(float(np.ptp(values)), 1e-300)
        if not far.any():
            return None
        start = float(knots[int(np.flatnonzero(far)[-1]) + 1])
        ramp, hold = start - float(knots[0]), float(knots[-1]) - start
        return start if hold > LONG_HOLD * max(ramp, 0.0) else None


def draw(results: StudyResults | str | Path) -> list[Figure]:
    """Return sheets of up to six records, from a study's `prepared/*.nc` or one prepared file."""
    if isinstance(results, StudyResults):
        paths = [results.folder / "prepared" / f"{name}.nc" for name in results.experiments]
    else:
        paths = [Path(results)]
    records = [PreparedRecord.read(path) for path in paths]
    return [_sheet(group) for group in panels.batches(records, RECORDS_PER_SHEET) if group]


def _sheet(records: Sequence[PreparedRecord]) -> Figure:
    """Return a sheet with up to three records in a row, each with its excitation below."""
    columns = min(len(records), 3)
    rows = -(-len(records) // columns)
    curves = all(record.is_curve for record in records)
    width = (0.6, 0.8, 1.0)[columns - 1] * style.DOUBLE_COLUMN
    height = rows * (44 if curves else 70) * style.MILLIMETRE + style.HEADER + 0.45
    figure = Figure(figsize=(width, height), layout="constrained")
    cells = figure.subfigures(rows, columns, squeeze=False).ravel()
    for cell, record in zip(cells, records, strict=False):
        ratios = [1] if record.is_curve else [1.7, 1]
        axes = cell.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios).ravel()
        _draw_response(axes[0], record)
        if not record.is_curve:
            _draw_excitation(axes[1], record)
        _title(axes[0], record.experiment)
    figure.legend(handles=_handles(curves), loc="outside lower center", ncols=min(columns + 1, 4))
    return figure


def _draw_response(ax: Axes, record: PreparedRecord) -> None:
    """Draw the raw samples, the hidden samples and the points of the likelihood."""
    experiment, unit = record.experiment, record.response_unit
    loop = record.is_loop
    at = experiment.excitation.at(experiment.coordinate)
    points = _across(record, at if loop else experiment.coordinate, loop)
    if record.raw is not None:
        x = _across(record, record.raw.excitation if loop else record.raw.coordinate, loop)
        y, hidden = record.raw.response / unit.factor, record.raw.masked
        ax.plot(x, y, color=style.GREY, alpha=0.55, linewidth=0.7, zorder=1)
        ax.plot(x[hidden], y[hidden], linestyle="none", marker="x", color=style.ORANGE,
                markersize=2.6, markeredgewidth=0.7, zorder=2)  # fmt: skip
    ax.plot(points, experiment.response / unit.factor, linestyle="none", marker="o",
            color=style.BLUE, markersize=1.8, markeredgewidth=0, zorder=3)  # fmt: skip
    ax.set_ylabel(plain(experiment.response_name) + unit.suffix)
    _label_across(ax, record, loop, labelled=loop or record.is_curve)


def _draw_excitation(ax: Axes, record: PreparedRecord) -> None:
    """Draw the excitation as recorded and as it drives the model."""
    excitation, unit = record.experiment.excitation, record.excitation_unit
    if record.raw is not None:
        ax.plot(_across(record, record.raw.coordinate), record.raw.excitation / unit.factor,
                color=style.GREY, alpha=0.55, linewidth=2.0)  # fmt: skip
    # the axis is not linear between knots, so the straight piece needs more points
    dense = np.unique(np.concatenate([excitation.coordinate, _spread(record)]))
    ax.plot(_across(record, dense), excitation.at(dense) / unit.factor,
            color=style.VERMILLION, linewidth=0.7)  # fmt: skip
    if excitation.coordinate.size <= MARKED_KNOTS:
        ax.plot(_across(record, excitation.coordinate), excitation.values / unit.factor,
                linestyle="none", marker="s", color=style.VERMILLION, markersize=2.2,
                markeredgewidth=0)  # fmt: skip
    ax.set_ylabel(f"{plain(excitation.name)}\n{unit.suffix.strip()}".strip())
    ax.yaxis.set_major_locator(MaxNLocator(3))
    _label_across(ax, record, loop=False, labelled=True)


def _across(record: PreparedRecord, values: FloatArray, excitation: bool = False) -> FloatArray:
    """Values for the horizontal axis in display units: excitation, time, or time since the hold."""
    if excitation:
        return values / record.excitation_unit.factor
    return (values - (record.turn() or 0.0)) / record.coordinate_unit.factor


def _spread(record: PreparedRecord) -> FloatArray:
    """Coordinate values that are dense near the start of the final hold."""
    first, last = record.experiment.excitation.coordinate[[0, -1]]
    turn = record.turn()
    if turn is None or last <= turn:
        return np.linspace(first, last, 2)
    return turn + np.geomspace(1e-4 * (last - turn), last - turn, 100)


def _label_across(ax: Axes, record: PreparedRecord, loop: bool, labelled: bool) -> None:
    """Set scale, ticks and label of the horizontal axis."""
    experiment, turn = record.experiment, record.turn()
    if loop:
        ax.set_xlabel(plain(experiment.excitation.name) + record.excitation_unit.suffix)
        ax.xaxis.set_major_locator(MaxNLocator(5))
        return
    name, suffix = plain(experiment.coordinate_name), record.coordinate_unit.suffix
    if turn is None:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    else:
        linear = _bend(ax, record, turn)
        name = f"{name} since the hold began"
        # on a separate line, because three such labels stand side by side
        suffix += f"\nlogarithmic beyond {linear:.2g}"
    if labelled:
        ax.set_xlabel(name + suffix)
    else:
        ax.tick_params(labelbottom=False)


def _bend(ax: Axes, record: PreparedRecord, turn: float) -> float:
    """Make the axis linear within the ramp's length of the turn, and logarithmic beyond.

    Return the length of the linear part on either side, in display units.
    """
    first, last = record.experiment.excitation.coordinate[[0, -1]]
    factor = record.coordinate_unit.factor
    ramp, hold = (turn - float(first)) / factor, (float(last) - turn) / factor
    linear = ramp or 1e-3 * hold
    # the ramp gets about as much room as two decades of the hold
    ax.set_xscale("symlog", linthresh=linear, linscale=1.2)
    decades = 10.0 ** np.arange(np.ceil(np.log10(1.5 * linear)), np.log10(hold) + 0.01)
    ax.set_xticks([-_rounded(ramp), 0.0, *decades], minor=False)
    ax.set_xticks([], minor=True)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlim(-1.15 * linear, 1.3 * hold)
    return linear


def _rounded(value: float) -> float:
    """Round down to one significant digit, for a tick."""
    if value <= 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(np.floor(value / power) * power)


def _title(ax: Axes, experiment: Experiment) -> None:
    """Write the record's name and its numbers of points and samples."""
    samples = int(experiment.samples_averaged.sum())
    words = f"{experiment.coordinate.size} points from {samples} samples"
    ax.set_title(experiment.name, loc="left", fontsize=7.0, pad=11, weight="bold")
    ax.annotate(words, (0, 1), (0, 2.5), "axes fraction", "offset points",
                fontsize=6.0, color=style.GREY, va="bottom")  # fmt: skip


def _handles(curves: bool) -> list[Line2D]:
    """Legend entries."""
    handles = [
        Line2D([], [], color=style.GREY, alpha=0.55, label="as recorded"),
        Line2D([], [], color=style.ORANGE, marker="x", linestyle="none", label=HIDDEN),
        Line2D([], [], color=style.BLUE, marker="o", linestyle="none", label=POINTS),
    ]
    if not curves:
        label = "excitation of the model, with its knots"
        handles.append(
            Line2D([], [], color=style.VERMILLION, marker="s", linewidth=0.7, label=label)
        )
    return handles
