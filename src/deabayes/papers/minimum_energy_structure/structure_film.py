"""Table 3 of the minimum-energy structure's paper: the film, and how well it is determined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import QUANTILES, Analysis, Row, StudyContext, interval, labels
from deabayes.posteriors.fitted import Fitted
from deabayes.systems.base import System

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Film (Table 3)"
PRIOR_DRAWS = 4000
PERCENT = 100.0
WHOLE = {
    "mu_0": ("kPa", 1e-3),
    "hinge_stiffness": ("mNmperrad", 1e3),
    "blocking_force_5kV": ("mN", 1e3),
    "slider_stiffness": ("Nperm", 1.0),
}
"""Unit and factor from SI of each quantity of the whole film."""
CAPTION = (
    "Coefficients and exponents of the Ogden terms, their shares μα/2 of the small-strain shear "
    "modulus μ0, and the effective permittivity; then what the whole film does at rest: stiffness "
    "K of a hinge, blocking force at 5 kV, stiffness of the slider without voltage. Medians with 5 "
    "to 95 % intervals. The film works near a stretch of 3.5, so μ0, its modulus without stretch, "
    "is an extrapolation by the terms. The paper's figures stand beside, term by term where there "
    "are as many (its third term is our first, because ours ascend by exponent); its μ0 and forces "
    "are those of its Table 3 in this specimen. Contraction: 1 − variance of the posterior over "
    "that of the prior; 100 %: the forces determine the quantity, 0 % or less: they say nothing "
    "about it. Half width: of the 5 to 95 % interval, over the median. μ and α of a term change "
    "sign together: an interval of either that spans zero covers separate films of both signs."
)
SCOPE = "study"
ANALYSIS = "structure_film"
FIGURE_TITLE = "What of the film is determined"
FIGURE_CAPTION = (
    "Left: how much narrower the posterior is than the prior (contraction), of each parameter and, "
    "above the line, of what the whole film does. Right: half the 5 to 95 % interval over the "
    "median. Many terms pull alike with many sets of coefficients and exponents."
)
NAMES = {
    "mu_0": r"$\mu_0$",
    "hinge_stiffness": "hinge stiffness $K$",
    "blocking_force_5kV": "blocking force at 5 kV",
    "slider_stiffness": "stiffness of the slider",
    "relative_permittivity": r"$\varepsilon_r$",
}


def compute(context: StudyContext) -> Analysis:
    """Return terms, whole film and contraction, for a study of forces at rest."""
    if not context.records("force", "quasi_static"):
        return Analysis()
    terms, whole, determined = [], [], []
    for name, fitted in context.candidates.items():
        film = of_film(fitted.system, fitted.draws)
        first = labels(name, fitted)
        terms += [first | row for row in term_rows(fitted)]
        whole.append(first | whole_row(fitted, film))
        determined += [first | row for row in determined_rows(context, name, film)]
    whole.append(paper_row(context))
    tables = {"table_3_terms": terms, "table_3_film": whole, "film_determined": determined}
    return Analysis.of_rows(tables)


def of_film(system: System, draws: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Quantities of the film, including those in `WHOLE`, SI, (W,) each."""
    from deabayes.systems.minimum_energy_structure.system import MinimumEnergyStructure

    assert isinstance(system, MinimumEnergyStructure)
    film = {name: each.values for name, each in system.derived(draws).items()}
    structure = system.structure(draws)
    lever = 2.0 * structure.length * np.sin(structure.rest)
    return film | {"slider_stiffness": structure.stiffness(structure.rest) / lever**2}


def term_rows(fitted: Fitted) -> Iterator[Row]:
    """Rows of mu_i, alpha_i and share of each Ogden term.

    The paper's values are added if the candidate has as many terms as the paper.
    """
    draws, count = fitted.draws, paper.count_of("alpha", fitted.draws)
    for i in range(1, count + 1):
        mu, alpha = draws[f"mu_{i}"], draws[f"alpha_{i}"]
        paper_mu, paper_alpha = np.nan, np.nan
        if count == paper.TERMS:
            paper_mu, paper_alpha = paper.FILM[f"mu_{i}"] / 1e3, paper.FILM[f"alpha_{i}"]
        yield {
            "term": i,
            **interval("mu", "kPa", mu / 1e3),
            "paper_mu_kPa": paper_mu,
            **interval("alpha", "", alpha),
            "paper_alpha": paper_alpha,
            **interval("share", "kPa", 0.5 * mu * alpha / 1e3),
            "paper_share_kPa": 0.5 * paper_mu * paper_alpha,
        }


def whole_row(fitted: Fitted, film: Mapping[str, FloatArray]) -> Row:
    """Row of the permittivity and the quantities in `WHOLE`."""
    row: Row = {}
    if "relative_permittivity" in fitted.draws:
        row |= interval("relative_permittivity", "", fitted.draws["relative_permittivity"])
    for name, (unit, factor) in WHOLE.items():
        row |= interval(name, unit, factor * film[name])
    return row


def paper_row(context: StudyContext) -> Row:
    """Row of the same quantities for the paper's Table 3 in this specimen."""
    system, draws = paper.film_of(context.specimen)
    film = of_film(system, draws)
    return {
        "candidate": paper.NAME,
        "order": paper.TERMS,
        "converged": True,
        "relative_permittivity": paper.FILM["relative_permittivity"],
        **{f"{n}_{unit}": factor * float(film[n][0]) for n, (unit, factor) in WHOLE.items()},
    }


def determined_rows(
    context: StudyContext, name: str, film: Mapping[str, FloatArray]
) -> Iterator[Row]:
    """Rows of contraction and relative half width, of film parameters and the whole film."""
    from deabayes.posteriors.file import contractions

    fitted, prior = context.candidates[name], context.prior_of(name)
    scores = prior.to_normal(np.stack([fitted.draws[n] for n in prior.names], axis=1))
    before = prior.sample(context.rng("structure_film"), PRIOR_DRAWS)
    prior_draws = dict(zip(prior.names, before.T, strict=True))
    prior_film = of_film(fitted.system, {n: prior_draws[n] for n in prior.names if "." not in n})
    own = [n for n in prior.names if n.startswith(("mu_", "alpha_")) or n in paper.FILM]
    posterior = {n: fitted.draws[n] for n in own} | {n: film[n] for n in WHOLE}
    gained = contractions(prior, scores, posterior, prior_draws | prior_film)
    for quantity, draws in posterior.items():
        low, middle, high = np.nanquantile(draws, [QUANTILES[0], 0.5, QUANTILES[1]])
        yield {
            "quantity": quantity,
            "of": "whole film" if quantity in WHOLE else "parameter",
            "contraction_percent": PERCENT * gained[quantity],
            "half_width_percent": PERCENT * 0.5 * (high - low) / abs(middle),
        }


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return two panels of points, with one row per quantity."""
    table = analysis.tables["film_determined"]
    whole = table[table["of"] == "whole film"]["quantity"].unique()
    single = table[table["of"] == "parameter"]["quantity"].unique()
    quantities = [*whole, *sorted(single, key=_place)]
    figure, ((left, right),) = panels.grid(1, 2, 0.22 * len(quantities) + 0.9, sharey=True)
    _points(left, table, quantities, "contraction_percent")
    _points(right, table, quantities, "half_width_percent")
    panels.name_rows(left, [_symbol(name) for name in quantities])
    left.set_xlabel("contraction (%)")
    left.set_xlim(min(-5.0, left.get_xlim()[0]), 104.0)
    right.set_xlabel("half width of the interval (% of the median)")
    panels.logarithmic(right, table["half_width_percent"].to_numpy())
    for ax in (left, right):
        ax.axhline(len(whole) - 0.5, color=style.GREY, linewidth=0.6)
    panels.legend_below(figure, panels.candidate_handles(table), 4)
    return [figure]


def _points(ax: Axes, table: pd.DataFrame, quantities: list[str], column: str) -> None:
    groups = table.groupby("candidate", sort=False)
    for k, (_, own) in enumerate(groups):
        values = own.set_index("quantity")[column].reindex(quantities)
        place = np.arange(len(quantities)) + panels.spread(k, len(groups))
        ax.plot(values, place, panels.marker(k), color=panels.colour(k), markersize=3.5)
    for row in range(len(quantities)):
        ax.axhline(row, color=style.LIGHT_GREY, linewidth=0.4, zorder=0)


def _place(quantity: str) -> tuple[int, str]:
    return ("relative_permittivity", "mu", "alpha").index(
        quantity if quantity in NAMES else quantity.partition("_")[0]
    ), quantity


def _symbol(quantity: str) -> str:
    head, _, index = quantity.partition("_")
    return NAMES.get(quantity, rf"$\{head}_{index}$")
