"""Force at rest over displacement under constant voltages, as in the paper's Fig. 7."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, band, interval, labels
from deabayes.prediction.errors import relative_maximum_error, relative_rms_error
from deabayes.quantities import ROLES, short

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Force against displacement (Fig. 7)"
CAPTION = (
    "Largest and rms error of the force over the record's range: of the posterior median curve, "
    "with the 5 to 95 % interval of the draws' own. Paper: its largest error at all voltages is "
    "“less than 6 %”, of what it does not say. Forces at 0 and 5 kV were fitted there and here."
)
PERCENT = 100.0


def compute(context: StudyContext) -> Analysis:
    """Return errors per candidate and voltage, and measured and predicted forces per record."""
    import pandas as pd

    records = sorted(context.records("force", "quasi_static"), key=paper.kilovolts)
    rows = [
        labels(name, fitted)
        | {"experiment": each.name, "voltage_kV": paper.kilovolts(each), "role": each.role}
        | errors(each, context.responses(name, each))
        | {"paper_below_percent": paper.FORCE_ERROR}
        for name, fitted in context.candidates.items()
        for each in records
    ]
    curves = {each.name: force_curves(context, each) for each in records}
    return Analysis({"force_errors": pd.DataFrame(rows)} if rows else {}, curves)


def errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_m and e_rms in percent of the record's range (equations.md section 4)."""
    middle = np.median(curves, axis=0)
    found: dict[str, float] = {}
    for name, measure in (("e_m", relative_maximum_error), ("e_rms", relative_rms_error)):
        of_draws = PERCENT * measure(experiment.response, curves)
        of_median = PERCENT * float(measure(experiment.response, middle))
        found |= interval(name, "percent", of_draws, of_median)
    return found


def force_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Data set of forces and errors, with bands (candidate, bound, displacement)."""
    names = list(context.candidates)
    forces = [context.responses(name, experiment) for name in names]
    share = [PERCENT * (experiment.response - f) / experiment.response_range for f in forces]
    along = ("candidate", "bound", "displacement")
    return xr.Dataset(
        {
            "measured": ("displacement", experiment.response, {"units": "N"}),
            "predicted": (along, np.array([band(f) for f in forces]), {"units": "N"}),
            "error": (along, np.array([band(e) for e in share]), {"units": "%"}),
            "paper": ("displacement", of_paper(context, experiment), {"units": "N"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "displacement": ("displacement", experiment.coordinate, {"units": "m"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "voltage_kV": paper.kilovolts(experiment)},
    )  # fmt: skip


def of_paper(context: StudyContext, experiment: Experiment) -> FloatArray:
    """Force (N,) of this specimen with the parameters of the paper's Table 3 [N]."""
    from deabayes.systems import build

    system = build(context.specimen.system, f"ogden_{paper.TERMS}", context.specimen)
    draws = {name: np.array([value]) for name, value in paper.FILM.items()}
    return system.predict(experiment.excitation, experiment.coordinate, "force", draws)[0]


SCOPE = "study"
ANALYSIS = "force_curve"
FIGURE_TITLE = "Force against displacement"
LIMIT = 6.0
FIGURE_CAPTION = (
    "Left: force on a slider held at rest at constant voltages, measured and as the recommended "
    "candidate predicts it (median and interval of the draws); grey: the paper's Table 3 in this "
    "specimen. Right: measured minus predicted in per cent of each record's range, every "
    "candidate; dotted: the 6 % the paper's errors stay below. Filled points were fitted."
)


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel with the forces of all voltages, and one panel of errors per voltage."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "voltage_kV")
    names = [str(name) for name in records[0]["candidate"].values]
    best = results.recommended.name
    shown = names.index(best) if best in names else 0
    height = 0.95 * len(records) + 0.7 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, max(height, 3.0)), layout="constrained")
    axes = figure.subplot_mosaic(
        [["forces", f"error {k}"] for k in range(len(records))], width_ratios=(5, 4)
    )
    for record in records:
        _forces(axes["forces"], record, shown)
    axes["forces"].set_xlabel("displacement (mm)")
    axes["forces"].set_ylabel("force on the slider, outwards (mN)")
    axes["forces"].set_title(f"predicted by {names[shown]}", loc="left", color=style.GREY)
    for k, record in enumerate(records):
        _error(axes[f"error {k}"], record)
    for k in range(len(records) - 1):
        axes[f"error {k}"].tick_params(labelbottom=False)
    axes[f"error {len(records) - 1}"].set_xlabel("displacement (mm)")
    paper = Line2D([], [], color=style.GREY, linestyle=(0, (1, 1)), label="paper's Table 3")
    panels.legend_below(figure, [*panels.handles(records[0]), paper], 4)
    return [figure]


def _forces(ax: Axes, record: xr.Dataset, shown: int) -> None:
    place = 1e3 * record["displacement"].values
    ax.plot(place, 1e3 * record["paper"].values, color=style.GREY, linestyle=(0, (1, 1)),
            linewidth=0.9)  # fmt: skip
    panels.draw_candidate(ax, place, 1e3 * record["predicted"].values[shown], shown)
    fitted = record.attrs["role"] == "calibrate"
    measured = 1e3 * record["measured"].values
    ax.plot(place, measured, "o", color=style.BLACK, markersize=1.8, markeredgewidth=0.4,
            markerfacecolor=style.BLACK if fitted else "white")  # fmt: skip
    ax.annotate(f"{short(record.attrs['voltage_kV'])} kV", (place[-1], measured[-1]), (4, 0),
                textcoords="offset points", va="center", fontsize=6.0)  # fmt: skip


def _error(ax: Axes, record: xr.Dataset) -> None:
    place = 1e3 * record["displacement"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, place, record["error"].values[k], k)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    for limit in (-LIMIT, LIMIT):
        ax.axhline(limit, color=style.GREY, linestyle=":", linewidth=0.8)
    ax.set_ylabel("error\n(% of range)")
    role = ROLES[str(record.attrs["role"])]
    ax.set_title(f"{short(record.attrs['voltage_kV'])} kV, {role}", loc="left")
