"""The paper's fit of the film by a genetic algorithm, compared with the posterior."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, Row, StudyContext, band, labels
from deabayes.posteriors.fitted import Fitted
from deabayes.systems.base import System

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Genetic algorithm beside the posterior"
SEEDS = (1, 2, 3, 4, 5)
GENERATIONS = paper.GA_GENERATIONS
PERCENT = 100.0
CAPTION = (
    "The paper's fit, (24) and (25), repeated with scipy's differential evolution, which is "
    "related to its genetic algorithm: least squares of the calibrated forces within the paper's "
    "bounds (μ 1 to 1000 kPa, α and εr 0 to 5), with its population and its number of generations. "
    "The specimen's other quantities are as stated. The stiffness K of the hinges follows from the "
    "rest angle; a measured K is not part of the fitness. An optimum with a K far from the "
    "measured one contradicts that measurement, which the posterior takes into account. Each row "
    "is one seed. If several optima fit equally well, the forces do not determine the terms. Rms: "
    "error of the force at the optimum; posterior rms: of the posterior median curve. Below: share "
    "of the posterior draws with a smaller value; at 0 or 100 % the optimum lies outside the "
    "draws. The bounds forbid negative exponents, even if the prior allows them. Generations: "
    "until the population's fitness agreed within 1 %, at most the paper's number."
)
SCOPE = "study"
ANALYSIS = "genetic_algorithm"
FIGURE_TITLE = "Genetic algorithm and posterior"
DECADE = 10.0
FIGURE_CAPTION = (
    "Left: each Ogden term's share μα/2 of the shear modulus against its exponent, one colour per "
    "term: draws of the posterior (points) and optima of the genetic algorithm (one marker per "
    "run). Right: rms error of the force at each optimum against the sum μ0 of its terms; line and "
    "band: the posterior's μ0; dotted: error of the posterior median. Optima far from the draws "
    "contradict the measured stiffness of the hinges, which only the posterior takes into account."
)


@dataclass(frozen=True)
class Optimum:
    """Result of one run: parameters (SI, exponents ascending), rms error [N], generations."""

    seed: int
    parameters: dict[str, float]
    rms: float
    generations: int


def compute(context: StudyContext) -> Analysis:
    """Return runs, their terms and posterior draws of every candidate without Maxwell units."""
    records = [e for e in context.records("force", "quasi_static") if e.role == "calibrate"]
    runs, terms, curves = [], [], {}
    for name, fitted in context.candidates.items():
        if not records or "alpha_1" not in fitted.draws or "tau_1" in fitted.draws:
            continue
        optima = [optimum(fitted.system, records, seed) for seed in SEEDS]
        first, posterior = labels(name, fitted), posterior_rms(context, name, records)
        runs += [first | run_row(fitted, each, posterior) for each in optima]
        terms += [first | row for each in optima for row in term_rows(fitted, each)]
        curves[name] = draws_and_optima(fitted, optima, posterior)
    tables = {"genetic_algorithm_runs": runs, "genetic_algorithm_terms": terms}
    return Analysis.of_rows(tables, curves)


def optimum(system: System, records: Sequence[Experiment], seed: int) -> Optimum:
    """Result of one run of differential evolution."""
    from scipy.optimize import differential_evolution

    bounds = {p.name: limits for p in system.parameters() if (limits := bounds_of(p.name))}
    names = list(bounds)
    result = differential_evolution(
        mean_square(system, records, names), list(bounds.values()), maxiter=GENERATIONS,
        popsize=max(round(paper.GA_POPULATION / len(names)), 1), rng=np.random.default_rng(seed),
        polish=False, vectorized=True, updating="deferred",
    )  # fmt: skip
    parameters = ascending(dict(zip(names, result.x.tolist(), strict=True)))
    return Optimum(seed, parameters, float(np.sqrt(result.fun)), int(result.nit))


def bounds_of(name: str) -> tuple[float, float] | None:
    """Bounds (25) of a parameter; None if the paper did not fit the parameter."""
    return paper.GA_BOUNDS.get(name if name in paper.GA_BOUNDS else name.partition("_")[0])


def mean_square(
    system: System, records: Sequence[Experiment], names: Sequence[str]
) -> Callable[[FloatArray], FloatArray]:
    """Return the function that computes the mean squared force error [N^2] of populations (P, S).

    Its value is very large where the error is not finite.
    """
    models = [system.simulator_of(e) for e in records]
    measured = np.concatenate([e.response for e in records])
    worst = 1e6 * float(np.mean(measured**2))

    def error(population: FloatArray) -> FloatArray:
        draws = dict(zip(names, population, strict=True))
        forces = np.concatenate([model(draws) for model in models], axis=1)
        squares = np.mean((forces - measured) ** 2, axis=1)
        return np.where(np.isfinite(squares), squares, worst)

    return error


def ascending(parameters: dict[str, float]) -> dict[str, float]:
    """Return the parameters with the terms in ascending order of their exponents."""
    numbers = range(1, paper.count_of("alpha", parameters) + 1)
    terms = sorted((parameters[f"alpha_{i}"], parameters[f"mu_{i}"]) for i in numbers)
    renamed = {f"mu_{i}": mu for i, (_, mu) in zip(numbers, terms, strict=True)}
    renamed |= {f"alpha_{i}": alpha for i, (alpha, _) in zip(numbers, terms, strict=True)}
    return parameters | renamed


def posterior_rms(context: StudyContext, name: str, records: Sequence[Experiment]) -> float:
    """Rms error [N] of the posterior median curves."""
    errors = [e.response - np.median(context.responses(name, e), axis=0) for e in records]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def shares(parameters: Mapping[str, FloatArray] | Mapping[str, float]) -> FloatArray:
    """Share mu_i alpha_i/2 of each term of the small-strain shear modulus, (term, ...) [Pa]."""
    numbers = range(1, paper.count_of("alpha", parameters) + 1)
    return np.array([0.5 * parameters[f"mu_{i}"] * parameters[f"alpha_{i}"] for i in numbers])


def hinge(system: System, parameters: Mapping[str, float]) -> float:
    """Stiffness of a hinge that follows from the rest angle [N m/rad]."""
    draws = {name: np.array([value]) for name, value in parameters.items()}
    return float(system.derived(draws)["hinge_stiffness"].values[0])


def below(draws: FloatArray, value: float) -> float:
    """Share of draws with a smaller value [%]."""
    return PERCENT * float(np.mean(draws < value))


def run_row(fitted: Fitted, best: Optimum, posterior: float) -> Row:
    """Row of one run: fitness, permittivity and mu_0, and where they lie in the posterior."""
    modulus = float(shares(best.parameters).sum())
    row: Row = {
        "seed": best.seed,
        "generations": best.generations,
        "rms_mN": 1e3 * best.rms,
        "posterior_rms_mN": 1e3 * posterior,
        "hinge_stiffness_mNmperrad": 1e3 * hinge(fitted.system, best.parameters),
        "mu_0_kPa": modulus / 1e3,
        "mu_0_below_percent": below(shares(fitted.draws).sum(axis=0), modulus),
    }
    permittivity = best.parameters.get("relative_permittivity")
    if permittivity is not None:
        of_draws = fitted.draws["relative_permittivity"]
        row |= {"relative_permittivity": permittivity}
        row |= {"relative_permittivity_below_percent": below(of_draws, permittivity)}
    return row


def term_rows(fitted: Fitted, best: Optimum) -> Iterator[Row]:
    """Rows of one run: each term, and where it lies in the posterior."""
    for i, share in enumerate(shares(best.parameters), start=1):
        mu, alpha = best.parameters[f"mu_{i}"], best.parameters[f"alpha_{i}"]
        yield {
            "seed": best.seed,
            "term": i,
            "mu_kPa": mu / 1e3,
            "mu_below_percent": below(fitted.draws[f"mu_{i}"], mu),
            "alpha": alpha,
            "alpha_below_percent": below(fitted.draws[f"alpha_{i}"], alpha),
            "share_kPa": share / 1e3,
        }


def draws_and_optima(fitted: Fitted, optima: Sequence[Optimum], posterior: float) -> xr.Dataset:
    """Data set of exponents, shares mu_i alpha_i/2 and mu_0, of draws and of optima."""
    runs = {n: np.array([o.parameters[n] for o in optima]) for n in optima[0].parameters}
    numbers = range(1, paper.count_of("alpha", runs) + 1)
    content: dict[str, tuple[object, FloatArray, dict[str, str]]] = {}
    for kind, values in (("draw", fitted.draws), ("run", runs)):
        alpha, share = np.array([values[f"alpha_{i}"] for i in numbers]), shares(values)
        content |= {
            f"{kind}_alpha": (("term", kind), alpha, {"units": "1"}),
            f"{kind}_share": (("term", kind), share, {"units": "Pa"}),
            f"{kind}_mu_0": (kind, share.sum(axis=0), {"units": "Pa"}),
        }
    modulus = band(shares(fitted.draws).sum(axis=0)[:, None])[:, 0]
    content["interval_mu_0"] = ("bound", modulus, {"units": "Pa"})
    content["run_rms"] = ("run", np.array([o.rms for o in optima]), {"units": "N"})
    return xr.Dataset(
        content,
        {
            "term": list(numbers),
            "run": [o.seed for o in optima],
            "bound": ["lower", "median", "upper"],
        },
        {
            "candidate": fitted.candidate,
            "converged": int(fitted.converged),
            "posterior_rms": posterior,
        },
    )


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return sheets with one row per candidate."""
    rows = sorted(analysis.curves.values(), key=lambda c: (c["term"].size, c.attrs["candidate"]))
    return [_sheet(list(group)) for group in panels.batches(rows, 4)]


def _sheet(rows: list[xr.Dataset]) -> Figure:
    figure, axes = panels.grid(len(rows), 2, 1.75 * len(rows) + 0.6, width_ratios=(5, 3))
    for (left, right), curves in zip(axes, rows, strict=True):
        _terms(left, curves)
        _moduli(right, curves)
        name = panels.marked(str(curves.attrs["candidate"]), bool(curves.attrs["converged"]))
        left.set_title(name, loc="left")
    axes[-1, 0].set_xlabel(r"exponent $\alpha_i$ (1)")
    axes[-1, 1].set_xlabel(r"$\mu_0$ (kPa)")
    terms = range(max(curves["term"].size for curves in rows))
    entries = [
        *(panels.key(f"draws, term {k + 1}", style.SERIES[k], marker=".") for k in terms),
        Line2D([], [], label="optima, one marker per run", **_marker(0, "white")),
        panels.key(r"posterior $\mu_0$ (band: 5–95 %)", style.GREY),
        panels.key("error of the posterior median", style.GREY, linestyle=":"),
    ]
    panels.legend_below(figure, entries, 4)
    return figure


def _terms(ax: Axes, curves: xr.Dataset) -> None:
    for k, colour in zip(range(curves["term"].size), style.SERIES, strict=False):
        ax.plot(curves["draw_alpha"].values[k], curves["draw_share"].values[k] / 1e3,
                linestyle="none", marker=".", markersize=2.5, markeredgewidth=0, alpha=0.45,
                color=colour, rasterized=True)  # fmt: skip
        optima = zip(curves["run_alpha"].values[k], curves["run_share"].values[k], strict=True)
        for run, (alpha, share) in enumerate(optima):
            ax.plot(alpha, share / 1e3, **_marker(run, colour))
    ax.set_yscale("log")
    ax.set_ylabel(r"$\mu_i\alpha_i/2$ (kPa)")


def _moduli(ax: Axes, curves: xr.Dataset) -> None:
    low, middle, high = curves["interval_mu_0"].values / 1e3
    of_posterior = 1e3 * float(curves.attrs["posterior_rms"])
    moduli, errors = curves["run_mu_0"].values / 1e3, 1e3 * curves["run_rms"].values
    ax.axvspan(low, high, color=style.LIGHT_GREY, linewidth=0)
    ax.axvline(middle, color=style.GREY, linewidth=1.0)
    ax.axhline(of_posterior, color=style.GREY, linestyle=":")
    for run, (modulus, error) in enumerate(zip(moduli, errors, strict=True)):
        ax.plot(modulus, error, **_marker(run, style.VERMILLION))
    panels.logarithmic(ax, np.append(moduli, curves["draw_mu_0"].values / 1e3))
    errors = np.append(errors, of_posterior)
    if errors.max() > DECADE * errors.min():
        ax.set_yscale("log")
    ax.set_ylabel("rms error of the force (mN)")


def _marker(run: int, colour: str) -> dict[str, Any]:
    return {"linestyle": "none", "marker": style.MARKERS[run % len(style.MARKERS)],
            "markersize": 4.5, "markerfacecolor": colour, "markeredgecolor": style.BLACK,
            "markeredgewidth": 0.6, "zorder": 4}  # fmt: skip
