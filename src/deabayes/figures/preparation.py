"""Every record before and after preparation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import LONG_HOLD, Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import DisplayUnit, display_unit, plain
from deabayes.records.preparation.prepared import RawOverview, read_overview, read_prepared

SCOPE = "study"
TITLE = "Records before and after preparation"
CAPTION = (
    "Grey: the raw record, thinned with its extremes kept. Orange crosses: samples hidden from the "
    "likelihood. Blue: the points of the likelihood, each the mean of the raw samples it stands "
    "for. Below each record the excitation as recorded (grey) and the polyline that drives the "
    "model (red, knots as squares). If a record ends in a long hold, its axis is the time since "
    "the ramp ended, linear up to the ramp's length and logarithmic beyond."
)
RECORDS_PER_SHEET = 6
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
        drive = self.experiment.excitation
        return display_unit(drive.unit, drive.values, drive.name)

    @property
    def response_unit(self) -> DisplayUnit:
        e = self.experiment
        return display_unit(e.response_unit, e.response, e.response_name)

    @property
    def coordinate_unit(self) -> DisplayUnit:
        e = self.experiment
        return display_unit(e.coordinate_unit, e.coordinate, e.coordinate_name)

    @property
    def is_curve(self) -> bool:
        """Whether the coordinate is the excitation, which then needs no panel of its own."""
        return self.experiment.coordinate_name == self.experiment.excitation.name

    @property
    def is_loop(self) -> bool:
        """Whether the response is drawn against the excitation, as for protocol `load_unload`."""
        return self.experiment.protocol == "load_unload"

    @property
    def ends(self) -> tuple[float, float]:
        """First and last coordinate of the excitation."""
        first, last = self.experiment.excitation.coordinate[[0, -1]].tolist()
        return first, last

    @cached_property
    def hold_start(self) -> float | None:
        """Coordinate at which the final long hold begins; None if the record has none."""
        excitation, (first, last) = self.experiment.excitation, self.ends
        start = excitation.settled(float(np.ptp(excitation.values)))
        is_long = first < start and last - start > LONG_HOLD * (start - first)
        return start if is_long and not self.is_curve else None

    def since_hold(self, coordinate: FloatArray) -> FloatArray:
        """Coordinate in display units, counted from the start of the final hold if there is one."""
        return (coordinate - (self.hold_start or 0.0)) / self.coordinate_unit.factor


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
    height = rows * (44 if curves else 70) * style.MILLIMETRE + 0.45
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
    experiment, unit, raw = record.experiment, record.response_unit, record.raw

    def across(coordinate: FloatArray, excitation: FloatArray) -> FloatArray:
        if record.is_loop:
            return excitation / record.excitation_unit.factor
        return record.since_hold(coordinate)

    if raw is not None:
        x, y = across(raw.coordinate, raw.excitation), raw.response / unit.factor
        hidden = raw.masked
        ax.plot(x, y, color=style.GREY, alpha=0.55, linewidth=0.7, zorder=1)
        ax.plot(x[hidden], y[hidden], linestyle="none", marker="x", color=style.ORANGE,
                markersize=2.6, markeredgewidth=0.7, zorder=2)  # fmt: skip
    x = across(experiment.coordinate, experiment.excitation.at(experiment.coordinate))
    ax.plot(x, experiment.response / unit.factor, linestyle="none", marker="o", color=style.BLUE,
            markersize=1.8, markeredgewidth=0, zorder=3)  # fmt: skip
    ax.set_ylabel(plain(experiment.response_name) + unit.suffix)
    if record.is_loop:
        ax.set_xlabel(plain(experiment.excitation.name) + record.excitation_unit.suffix)
        ax.xaxis.set_major_locator(MaxNLocator(5))
    else:
        _label_coordinate(ax, record, record.is_curve)


def _draw_excitation(ax: Axes, record: PreparedRecord) -> None:
    """Draw the excitation as recorded and as it drives the model."""
    excitation, unit = record.experiment.excitation, record.excitation_unit
    knots = excitation.coordinate
    if record.raw is not None:
        ax.plot(record.since_hold(record.raw.coordinate), record.raw.excitation / unit.factor,
                color=style.GREY, alpha=0.55, linewidth=2.0)  # fmt: skip
    # the axis is not linear between knots, so the straight piece needs more points
    dense, last, start = np.unique(knots), record.ends[1], record.hold_start
    if start is not None and last > start:
        later = start + np.geomspace(1e-4 * (last - start), last - start, 100)
        dense = np.unique(np.concatenate([knots, later]))
    ax.plot(record.since_hold(dense), excitation.at(dense) / unit.factor,
            color=style.VERMILLION, linewidth=0.7)  # fmt: skip
    if knots.size <= MARKED_KNOTS:
        ax.plot(record.since_hold(knots), excitation.values / unit.factor, linestyle="none",
                marker="s", color=style.VERMILLION, markersize=2.2,
                markeredgewidth=0)  # fmt: skip
    ax.set_ylabel(f"{plain(excitation.name)}\n{unit.suffix.strip()}".strip())
    ax.yaxis.set_major_locator(MaxNLocator(3))
    _label_coordinate(ax, record, labelled=True)


def _label_coordinate(ax: Axes, record: PreparedRecord, labelled: bool) -> None:
    """Set scale, ticks and label of the coordinate's axis."""
    name, suffix = plain(record.experiment.coordinate_name), record.coordinate_unit.suffix
    if record.hold_start is None:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    else:
        linear = _scale_hold(ax, record, record.hold_start)
        name = f"{name} since the hold began"
        # on a separate line, because three such labels stand side by side
        suffix += f"\nlogarithmic beyond {linear:.2g}"
    if labelled:
        ax.set_xlabel(name + suffix)
    else:
        ax.tick_params(labelbottom=False)


def _scale_hold(ax: Axes, record: PreparedRecord, start: float) -> float:
    """Make the axis linear within the ramp's length of the hold's start, and logarithmic beyond.

    Return the length of the linear part on either side, in display units.
    """
    first, last = record.ends
    factor = record.coordinate_unit.factor
    ramp, hold = (start - first) / factor, (last - start) / factor
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
        panels.key("as recorded", style.GREY, alpha=0.55),
        panels.key(HIDDEN, style.ORANGE, marker="x"),
        panels.key(POINTS, style.BLUE, marker="o"),
    ]
    label = "excitation of the model, with its knots"
    drive = panels.key(label, style.VERMILLION, marker="s", linestyle="-", linewidth=0.7)
    return handles if curves else [*handles, drive]
