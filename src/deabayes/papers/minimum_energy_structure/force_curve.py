"""Force at rest over displacement under constant voltages, as in the paper's Fig. 7."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, bands, curve_set, error_interval
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
SCOPE = "study"
ANALYSIS = "force_curve"
FIGURE_TITLE = "Force against displacement"
DOTTED = (0, (1, 1))
FIGURE_CAPTION = (
    "Left: force on a slider held at rest at constant voltages, measured and as the recommended "
    "candidate predicts it (median and interval of the draws); grey: the paper's Table 3 in this "
    "specimen. Right: measured minus predicted in per cent of each record's range, every "
    "candidate; dotted: the 6 % the paper's errors stay below. Filled points were fitted."
)


def compute(context: StudyContext) -> Analysis:
    """Return errors per candidate and voltage, and measured and predicted forces per record."""
    records = sorted(context.records("force", "quasi_static"), key=paper.kilovolts)
    rows = [
        first
        | {"experiment": record.name, "voltage_kV": paper.kilovolts(record), "role": record.role}
        | errors(record, curves)
        | {"paper_below_percent": paper.FORCE_ERROR}
        for first, record, curves in context.predicted(records)
    ]
    curves = {record.name: force_curves(context, record) for record in records}
    return Analysis.of_rows({"force_errors": rows}, curves)


def errors(experiment: Experiment, curves: FloatArray) -> dict[str, float]:
    """e_m and e_rms in percent of the record's range (equations.md section 4)."""
    y = experiment.response
    return {
        **error_interval("e_m", curves, lambda c: PERCENT * relative_maximum_error(y, c)),
        **error_interval("e_rms", curves, lambda c: PERCENT * relative_rms_error(y, c)),
    }


def force_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Data set of forces and errors, with bands (candidate, bound, displacement)."""
    y, size = experiment.response, experiment.response_range
    return curve_set(
        context,
        {"displacement": (experiment.coordinate, "m")},
        {
            "measured": (y, "N"),
            "predicted": (bands(context, experiment), "N"),
            "error": (bands(context, experiment, lambda c: PERCENT * (y - c) / size), "%"),
            "paper": (of_paper(context, experiment), "N"),
        },
        experiment,
        voltage_kV=paper.kilovolts(experiment),
    )


def of_paper(context: StudyContext, experiment: Experiment) -> FloatArray:
    """Force (N,) of this specimen with the parameters of the paper's Table 3 [N]."""
    system, draws = paper.film_of(context.specimen)
    return system.predict(experiment.excitation, experiment.coordinate, "force", draws)[0]


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one panel with the forces of all voltages, and one panel of errors per voltage."""
    records = panels.by_size(analysis.curves.values(), "voltage_kV")
    shown = panels.place_of(results.recommended.name, records[0])
    height = max(0.95 * len(records) + 0.7, 2.8)
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    names = [f"error {k}" for k in range(len(records))]
    axes = figure.subplot_mosaic([["forces", name] for name in names], width_ratios=(5, 4))
    for name, record in zip(names, records, strict=True):
        _forces(axes["forces"], record, shown)
        _error(axes[name], record)
        axes[name].tick_params(labelbottom=name == names[-1])
    axes["forces"].set_ylabel("force on the slider, outwards (mN)")
    candidate = str(records[0]["candidate"].values[shown])
    axes["forces"].set_title(f"predicted by {candidate}", loc="left", color=style.GREY)
    for name in ("forces", names[-1]):
        axes[name].set_xlabel("displacement (mm)")
    of_paper = panels.key("paper's Table 3", style.GREY, linestyle=DOTTED)
    panels.legend_below(figure, [*panels.handles(records[0]), of_paper], 4)
    return [figure]


def _forces(ax: Axes, record: xr.Dataset, shown: int) -> None:
    place = 1e3 * record["displacement"].values
    of_paper = 1e3 * record["paper"].values
    ax.plot(place, of_paper, color=style.GREY, linestyle=DOTTED, linewidth=0.9)
    panels.draw_candidate(ax, place, 1e3 * record["predicted"].values[shown], shown)
    fitted = record.attrs["role"] == "calibrate"
    measured = 1e3 * record["measured"].values
    ax.plot(place, measured, "o", color=style.BLACK, markersize=1.8, markeredgewidth=0.4,
            markerfacecolor=style.BLACK if fitted else "white")  # fmt: skip
    ax.annotate(f"{short(record.attrs['voltage_kV'])} kV", (place[-1], measured[-1]), (4, 0),
                textcoords="offset points", va="center", fontsize=6.0)  # fmt: skip


def _error(ax: Axes, record: xr.Dataset) -> None:
    place = 1e3 * record["displacement"].values
    panels.draw_candidates(ax, place, record["error"].values)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    for limit in (-paper.FORCE_ERROR, paper.FORCE_ERROR):
        ax.axhline(limit, color=style.GREY, linestyle=":", linewidth=0.8)
    ax.set_ylabel("error\n(% of range)")
    role = ROLES[str(record.attrs["role"])]
    ax.set_title(f"{short(record.attrs['voltage_kV'])} kV, {role}", loc="left")
