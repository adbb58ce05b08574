"""Interactive figures of the page: data, bands and residuals of every record on one time axis.

Bokeh's script is on the page once, compressed. So is a figure without data, one per kind of axes.
The page's script fills it with a record's curves when a reader opens it.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.figures.record import Record, side_by_side
from deabayes.figures.results import CandidateResults

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource
    from bokeh.plotting import figure as BokehFigure

MOST_POINTS = 400
"""Points of a record in a figure; a longer record is shown as in the printed figures, thinned."""
IN_CYCLES = ("sine", "load_unload")
RESOLUTION = 4000
"""Steps into which the largest deviation from the median is divided."""
DIGITS = 6
BANDS = tuple(f"{name}_{bound}" for name in style.BANDS for bound in ("lower", "upper"))
COLUMNS = ("x", "observed", "median", "residual", "zero", *BANDS)
COLUMNS_OF_RESIDUALS = tuple(f"{name}_residual" for name in BANDS)
AXES = {"linear": ("linear", "linear"), "log": ("log", "linear"), "loglog": ("log", "log")}
"""Kinds of horizontal and vertical axis."""


class _Whole(Record):
    """A record of which all cycles are shown if it has few points."""

    @property
    def shown(self) -> slice:
        few = self.prediction.sizes["coordinate"] <= MOST_POINTS
        return slice(None) if few and self.protocol in IN_CYCLES else super().shown


def curves(results: CandidateResults) -> list[dict[str, Any]]:
    """Curves of every record of a candidate, in display units, ready for JSON.

    The median, readings and bands of a record share a `step`. They are whole multiples of it, and
    each is the list of its first value and its increments, because these compress well.
    """
    records = side_by_side(results.predictions.values())
    return [_curves(_Whole(**vars(record))) for record in records]


def _curves(record: Record) -> dict[str, Any]:
    x = record.against_coordinate()
    kept = np.unique(np.linspace(0, x.values.size - 1, MOST_POINTS).round().astype(int))
    named = {"observed": record.response("observed")[kept]}
    about = named["observed"].mean()
    if record.responds:
        about = named["median"] = record.response("median")[kept]
        for name in style.BANDS:
            lower, upper = record.band(name)[:, kept]
            named |= {f"{name}_lower": lower, f"{name}_upper": upper}
    deviation = max(float(np.nanmax(np.abs(values - about))) for values in named.values())
    step = _rounded(deviation / RESOLUTION) or 1.0
    return {
        "name": record.name,
        "role": record.role,
        "axes": _axes(x.logarithmic, record.spans_decades),
        "labels": [x.label, record.label, f"residual{record.unit.suffix}"],
        "points": [int(kept.size), int(record.prediction.sizes["coordinate"])],
        "step": step,
        "x": [_rounded(value) for value in x.values[kept]],
        "curves": {name: _increments(values, step) for name, values in named.items()},
    }


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _axes(x_log: bool, y_log: bool) -> str:
    if y_log:
        return "loglog"
    return "log" if x_log else "linear"


def _increments(values: FloatArray, step: float) -> list[int | None]:
    """First value and increments in units of `step`; a value that is not finite is None."""
    counts = np.round(values / step)
    increments: list[int | None] = []
    before = 0
    for count in counts:
        if np.isfinite(count):
            increments.append(int(count) - before)
            before = int(count)
        else:
            increments.append(None)
    return increments


def templates(kinds: Iterable[str]) -> dict[str, Any]:
    """Figures without data as Bokeh's JSON, by kind of axes."""
    from bokeh.embed import json_item

    return {kind: json_item(_layout(*AXES[kind])) for kind in sorted(set(kinds))}


def _layout(x_axis: str, y_axis: str) -> Any:
    from bokeh.layouts import gridplot
    from bokeh.models import ColumnDataSource, CrosshairTool, Span

    empty: dict[str, list[float]] = {name: [] for name in (*COLUMNS, *COLUMNS_OF_RESIDUALS)}
    source = ColumnDataSource(empty, name="curves")
    response = _panel(300, x_axis, y_axis)
    residuals = _panel(190, x_axis, "linear", x_range=response.x_range)
    _draw(response, source, "observed", "median")
    _draw(residuals, source, "residual", "zero", "_residual")
    line = Span(dimension="height", line_color=style.GREY, line_width=0.7)
    for plot in (response, residuals):
        plot.add_tools(CrosshairTool(overlay=line, dimensions="height"))
    response.xaxis.visible = False
    residuals.yaxis.formatter.power_limit_low = -6  # 0.0005 and not 5.000e-4
    residuals.xaxis.name, response.yaxis.name, residuals.yaxis.name = "label0", "label1", "label2"
    return gridplot(
        [[response], [residuals]],
        sizing_mode="stretch_width",
        toolbar_location="above",
        toolbar_options={"logo": None},
    )


def _draw(
    plot: BokehFigure, source: ColumnDataSource, points: str, line: str, ending: str = ""
) -> None:
    """Draw bands, a line and points from columns; the bands' names end in `ending`."""
    from bokeh.models import HoverTool

    for name, (colour, _) in style.BANDS.items():
        ends = {"y1": f"{name}_lower{ending}", "y2": f"{name}_upper{ending}"}
        plot.varea("x", source=source, fill_color=colour, **ends)
    for bound in ("lower", "upper"):
        edge = f"predictive_{bound}{ending}"
        plot.line("x", edge, source=source, color=style.GREY, line_width=0.7)
    plot.line("x", line, source=source, color=style.BLUE, line_width=1.6)
    drawn = plot.scatter("x", points, source=source, color=style.BLACK, size=3.5)
    tips = [(name, f"@{name}{{0.0000a}}") for name in ("x", "observed", "median", "residual")]
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=tips))


def _panel(height: int, x_axis: str, y_axis: str, **ranges: Any) -> BokehFigure:
    from bokeh.plotting import figure

    plot = figure(
        height=height,
        x_axis_type=x_axis,
        y_axis_type=y_axis,
        tools="box_zoom,xwheel_zoom,pan,reset,save",
        active_drag="box_zoom",
        min_border_left=62,
        sizing_mode="stretch_width",
        **ranges,
    )
    plot.outline_line_color = None
    plot.grid.grid_line_color = "#ececec"
    plot.axis.axis_label_text_font_style = "normal"
    plot.axis.axis_label_text_font_size = plot.axis.major_label_text_font_size = "12px"
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = style.GREY
    plot.axis.minor_tick_line_color = None
    return plot


def script() -> str:
    """Bokeh's script."""
    from bokeh.resources import Resources

    return "\n".join(Resources(mode="inline", components=["bokeh"], log_level="error").js_raw)


def payload(text: str) -> str:
    """Compress a text for the page, which decompresses it when it is needed."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), 9, mtime=0)).decode("ascii")


def payloads(curves_of: Mapping[str, list[dict[str, Any]]]) -> dict[str, str]:
    """Compressed texts by the id of their element: the script, the templates, each candidate.

    Parameters
    ----------
    curves_of : curves of each candidate by the id of its element.
    """
    kinds = [record["axes"] for records in curves_of.values() for record in records]
    if not kinds:
        return {}
    shared = {"bokeh": payload(script()), "templates": payload(json.dumps(templates(kinds)))}
    data = {k: payload(json.dumps(v, separators=(",", ":"))) for k, v in curves_of.items()}
    return shared | data
