"""Contents of the page: fill the template from results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from deabayes.figures import SavedFigure, style
from deabayes.figures.results import CandidateResults, PopulationResults, StudyResults
from deabayes.quantities import plain
from deabayes.report import cards, interactive, notices, tables, words
from deabayes.report.images import Image, address

PACKAGES = ("deabayes", "numpy", "scipy", "numba", "emcee", "xarray", "arviz-stats", "matplotlib")
SECTIONS = {
    "Data and predictions": ("data_and_bands",),
    "Residuals": ("residuals", "noise_share", "coverage", "pit"),
    "Parameters": ("marginals", "identifiability", "pairs"),
    "Convergence": ("convergence",),
    "Prior": ("prior_predictive",),
}
"""Figures of the recommended candidate by section."""
OF_OTHERS = ("marginals", "convergence")
"""Figures of other candidates; their data and residuals are in an interactive figure."""
OF_A_POPULATION = ("shrinkage", "new_specimen")
TABLE_OF = {
    "data_and_bands": "{candidate}_predictions",
    "residuals": "{candidate}_predictions",
    "coverage": "errors",
    "pit": "errors",
    "errors": "errors",
    "marginals": "summary",
    "identifiability": "summary",
    "convergence": "summary",
    "comparison": "comparison",
    "further_experiments": "further_experiments",
}
"""Table of the report that holds the numbers of a figure, without the study's name."""
PARTS = ("Caution", "Parameters", "Errors", "Predictions", "Order", "Paper", "Records", "Others")
"""Parts of a study's section to which the contents lead, if it has them."""
KEY = (
    (style.BLACK, "observed"),
    (style.BLUE, "median"),
    *((colour, f"90 % {name}") for name, (colour, _) in style.BANDS.items()),
)
"""Colours of the interactive figures and what they mean."""
EFFORT = {"ensembles": "independent runs", "walkers": "walkers each", "steps": "steps"}

Figures = Sequence[SavedFigure]
Images = Mapping[Path, Image]


@dataclass(frozen=True)
class Place:
    """Where the page and the folder of its tables are written."""

    page: Path
    tables: Path

    def csv(self, name: str) -> str:
        """Address of a table from the page."""
        return address(self.tables / f"{name}.csv", self.page)


@dataclass(frozen=True)
class Drawn:
    """A figure on the page: its sheets, and links to tables with its numbers."""

    title: str
    caption: str
    images: Sequence[Image]
    data: Sequence[tuple[str, str]]


def shown(figures: Figures, results: StudyResults | PopulationResults) -> list[SavedFigure]:
    """Select the sheets that are on the page: not all of candidates that are not recommended."""
    if isinstance(results, PopulationResults):
        return list(figures)
    best = results.recommended.name
    return [f for f in figures if f.candidate in ("", best) or f.name in OF_OTHERS]


def render(
    studies: Sequence[StudyResults],
    figures: Mapping[Path, Figures],
    left_out: Sequence[str],
    images: Images,
    place: Place,
    populations: Sequence[PopulationResults] = (),
    failed: Sequence[notices.Notice] = (),
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    figures : saved figures of every results folder.
    images : embedded image of each sheet, by PNG path.
    failed : notices of results that are missing.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("deabayes.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    folder = files("deabayes.report.page")
    shown = {study.name for study in studies} | {p.name for p in populations}
    curves = {
        _curves_id(c): interactive.curves(c)
        for study in studies
        for c in study.candidates
        if c.predictions
    }
    return environment.get_template("index.html").render(
        words=words,
        css=(folder / "style.css").read_text(encoding="utf-8"),
        script=(folder / "page.js").read_text(encoding="utf-8"),
        payloads=interactive.payloads(curves),
        studies=[_study(study, figures[study.folder], images, place) for study in studies],
        populations=[_population(p, figures[p.folder], images, place) for p in populations],
        left_out=list(left_out),
        failed=failed,
        missing=lambda name: [notice for notice in failed if notice.study == name],
        without_results=sorted({notice.study for notice in failed} - shown - {""}),
        tables_folder=place.tables.as_posix(),
        figure_folders=figure_folders(studies, populations),
        versions=_versions(studies),
        built=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def _curves_id(candidate: CandidateResults) -> str:
    return f"curves-{candidate.study.name}-{candidate.name}"


def figure_folders(
    studies: Sequence[StudyResults], populations: Sequence[PopulationResults]
) -> list[str]:
    """Figure folders, with `<study>` or `<population>` in place of the names."""
    named = [(study.folder, "<study>") for study in studies]
    named += [(population.folder, "<population>") for population in populations]
    places = ((folder if folder.name else folder.resolve(), word) for folder, word in named)
    return list(dict.fromkeys((f.parent / word / "figures").as_posix() for f, word in places))


def _study(study: StudyResults, figures: Figures, images: Images, place: Place) -> dict[str, Any]:
    best = study.recommended
    specimen = best.attributes.get("specimen") or {}
    embedded = _Embedder(study.name, figures, images, place)
    found = notices.of_study(study)
    result = {
        "name": study.name,
        "card": cards.card(study, found),
        "serious": [notice for notice in found if notice.serious],
        "notes": [notice for notice in found if not notice.serious],
        "provenance": study.provenance,
        "source": (specimen.get("provenance") or {}).get("source", ""),
        "specimen": specimen.get("name", ""),
        "system": best.attributes.get("system", ""),
        "noise": best.attributes.get("noise", ""),
        "verdict": words.verdict(study),
        "records": tables.records(study),
        "comparison": tables.comparison(study),
        "nested": tables.has_nested(study),
        "may_hide": words.may_hide(study),
        "comparison_figures": embedded.of("", "comparison"),
        "further": words.further_sentence(study),
        "further_rows": tables.further_experiments(study),
        "further_figures": embedded.of("", "further_experiments"),
        "errors_figures": embedded.of("", "errors"),
        "analyses": _analyses(study, embedded, place),
        "preparation_figures": embedded.of("", "preparation"),
        "csv": {
            kind: place.csv(f"{study.name}_{kind}")
            for kind in ("summary", "errors", "comparison", "further_experiments")
        },
        "best": _candidate(best, place) | {"sections": _sections(best.name, embedded)},
        "others": [_other(c, embedded, place) for c in study.candidates if c is not best],
    }
    missing = {"Order": "comparison", "Paper": "analyses", "Others": "others"}
    return result | {"parts": [p for p in PARTS if p not in missing or result[missing[p]]]}


@dataclass(frozen=True)
class _Embedder:
    """Saved figures of a study or population, ready for the page."""

    name: str
    figures: Figures
    images: Images
    place: Place

    def of(self, candidate: str, *names: str) -> list[Drawn]:
        """Return the named figures of a candidate that were drawn; of the study without one."""
        return [drawn for name in names if (drawn := self._drawn(candidate, name))]

    def _drawn(self, candidate: str, name: str) -> Drawn | None:
        sheets = [f for f in self.figures if (f.candidate, f.name) == (candidate, name)]
        if not sheets:
            return None
        table = TABLE_OF.get(name, "").format(candidate=candidate)
        data = [("CSV", self.place.csv(f"{self.name}_{table}"))] if table else []
        return self.with_data(sheets, data)

    def with_data(self, sheets: Figures, data: Sequence[tuple[str, str]]) -> Drawn:
        """Return the sheets of one figure, with links to its numbers."""
        first = sheets[0]
        return Drawn(first.title, first.caption, [self.images[s.png] for s in sheets], data)


def _analyses(study: StudyResults, embedded: _Embedder, place: Place) -> list[dict[str, Any]]:
    """Sections of the analyses, each with its figures and tables; empty ones are left out."""
    sections = []
    for analysis in study.analyses:
        own = [
            figure
            for figure in embedded.figures
            if figure.analysis == analysis.name and figure.candidate in ("", study.recommended.name)
        ]
        addresses = {name: place.csv(f"{study.name}_{name}") for name in analysis.table_names}
        data = [(f"CSV {plain(name)}", csv) for name, csv in addresses.items()]
        by_name = (
            [figure for figure in own if figure.name == name]
            for name in dict.fromkeys(figure.name for figure in own)
        )
        readable = tables.of_analysis(analysis)
        if own or readable:
            sections.append(
                {
                    "title": analysis.title,
                    "caption": analysis.caption,
                    "figures": [embedded.with_data(sheets, data) for sheets in by_name],
                    "tables": {n: t | {"csv": addresses[n]} for n, t in readable.items()},
                }
            )
    return sections


def _candidate(results: CandidateResults, place: Place) -> dict[str, Any]:
    convergence = results.convergence
    return {
        "name": results.name,
        "converged": results.converged,
        "effort": [(text, convergence[key]) for key, text in EFFORT.items() if key in convergence],
        "errors": tables.errors(results),
        "parameters": tables.parameters(results),
        "curves": _curves_id(results) if results.predictions else "",
        "key": KEY,
        "data": [("CSV", place.csv(f"{results.study.name}_{results.name}_predictions"))],
    }


def _sections(best: str, embedded: _Embedder) -> dict[str, list[Drawn]]:
    """Figures of the recommended candidate by section; empty sections are left out."""
    drawn = {title: embedded.of(best, *names) for title, names in SECTIONS.items()}
    return {title: pictures for title, pictures in drawn.items() if pictures}


def _other(results: CandidateResults, embedded: _Embedder, place: Place) -> dict[str, Any]:
    return _candidate(results, place) | {
        "figures": embedded.of(results.name, *OF_OTHERS),
        "notices": [*notices.unconverged(results), *notices.of_candidate(results)],
    }


def _population(
    population: PopulationResults, figures: Figures, images: Images, place: Place
) -> dict[str, Any]:
    embedded = _Embedder(f"population_{population.name}", figures, images, place)
    return {
        "name": population.name,
        "candidate": population.attributes["candidate"],
        "system": population.system,
        "provenance": population.provenance,
        "converged": population.converged,
        "members": population.members,
        "notices": notices.of_population(population),
        "parameters": tables.population_parameters(population),
        "specimens": tables.specimens(population),
        "figures": embedded.of("", *OF_A_POPULATION),
        "csv": {
            kind: place.csv(f"population_{population.name}_{kind}")
            for kind in ("summary", "shrinkage")
        },
    }


def _versions(studies: Sequence[StudyResults]) -> dict[str, str]:
    """Versions of the packages, and of deabayes at the time of older fits."""
    known = {}
    for package in PACKAGES:
        try:
            known[package] = version(package)
        except PackageNotFoundError:
            continue
    fitted = {str(c.attributes.get("deabayes_version", "")) for s in studies for c in s.candidates}
    stale = sorted(fitted - {known.get("deabayes", ""), ""})
    return known | ({"fitted with deabayes": ", ".join(stale)} if stale else {})
