"""Contents of the page: fill the template from results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from deabayes.figures import OF_OTHERS, SavedFigure
from deabayes.figures.results import CandidateResults, PopulationResults, StudyResults
from deabayes.report import notices, tables, words
from deabayes.report.images import Image

PACKAGES = ("deabayes", "numpy", "scipy", "numba", "emcee", "xarray", "arviz-stats", "matplotlib")
SECTIONS = {
    "Data and predictions": ("data_and_bands",),
    "Residuals": ("residuals", "noise_share", "coverage", "pit"),
    "Parameters": ("marginals", "identifiability", "pairs"),
    "Convergence": ("convergence",),
    "Prior": ("prior_predictive",),
}
"""Figures of the recommended candidate by section."""
OF_A_POPULATION = ("shrinkage", "new_specimen")
EFFORT = {"ensembles": "independent runs", "walkers": "walkers each", "steps": "steps"}

Figures = Sequence[SavedFigure]
Images = Mapping[Path, Image]


def render(
    studies: Sequence[StudyResults],
    figures: Mapping[Path, Figures],
    left_out: Sequence[str],
    images: Images,
    populations: Sequence[PopulationResults] = (),
    tables_folder: Path = Path("tables"),
    failed: Sequence[notices.Notice] = (),
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    figures : saved figures of every results folder.
    images : embedded image of each sheet, by PNG path.
    failed : notices of results that are missing.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    folder = files("deabayes.report")
    template = environment.from_string((folder / "template.html").read_text(encoding="utf-8"))
    all_notices = [notice for study in studies for notice in notices.of_study(study)]
    all_notices += [notice for p in populations for notice in notices.of_population(p)]
    shown = {study.name for study in studies} | {p.name for p in populations}
    return template.render(
        words=words,
        css=(folder / "style.css").read_text(encoding="utf-8"),
        studies=[_study(study, figures[study.folder], images) for study in studies],
        populations=[_population(p, figures[p.folder], images) for p in populations],
        serious=[notice for notice in all_notices if notice.serious],
        notes=[notice for notice in all_notices if not notice.serious],
        left_out=list(left_out),
        failed=failed,
        without_results=sorted({notice.study for notice in failed} - shown - {""}),
        tables_folder=tables_folder.as_posix(),
        figure_folders=figure_folders(studies, populations),
        versions=_versions(studies),
        built=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def figure_folders(
    studies: Sequence[StudyResults], populations: Sequence[PopulationResults]
) -> list[str]:
    """Figure folders, with `<study>` or `<population>` in place of the names."""
    named = [(study.folder, "<study>") for study in studies]
    named += [(population.folder, "<population>") for population in populations]
    places = ((folder if folder.name else folder.resolve(), word) for folder, word in named)
    return list(dict.fromkeys((f.parent / word / "figures").as_posix() for f, word in places))


def _study(study: StudyResults, figures: Figures, images: Images) -> dict[str, Any]:
    best = study.recommended
    specimen = best.attributes.get("specimen") or {}
    of_study = [figure for figure in figures if not figure.candidate]
    return {
        "name": study.name,
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
        "comparison_figures": _embedded(of_study, ("comparison",), images),
        "further": words.further_sentence(study),
        "further_rows": tables.further_experiments(study),
        "further_figures": _embedded(of_study, ("further_experiments",), images),
        "errors_figures": _embedded(of_study, ("errors",), images),
        "analyses": _analyses(study, figures, images),
        "preparation_figures": _embedded(figures, ("preparation",), images),
        "best": _candidate(best)
        | {"sections": _sections([f for f in figures if f.candidate == best.name], images)},
        "others": [_other(c, figures, images) for c in study.candidates if c is not best],
    }


def _analyses(study: StudyResults, figures: Figures, images: Images) -> list[dict[str, Any]]:
    """Sections of the analyses, each with its figures and tables; empty ones are left out."""
    sections = []
    for analysis in study.analyses:
        own = [
            figure
            for figure in figures
            if figure.analysis == analysis.name and figure.candidate in ("", study.recommended.name)
        ]
        readable = tables.of_analysis(analysis)
        if own or readable:
            sections.append(
                {
                    "title": analysis.title,
                    "caption": analysis.caption,
                    "figures": _embedded(own, dict.fromkeys(f.name for f in own), images),
                    "tables": readable,
                }
            )
    return sections


def _candidate(results: CandidateResults) -> dict[str, Any]:
    convergence = results.convergence
    return {
        "name": results.name,
        "converged": results.converged,
        "effort": [(text, convergence[key]) for key, text in EFFORT.items() if key in convergence],
        "errors": tables.errors(results),
        "parameters": tables.parameters(results),
    }


def _sections(own: Figures, images: Images) -> dict[str, list[tuple[str, str, list[Image]]]]:
    """Figures of the recommended candidate by section; empty sections are left out."""
    drawn = {title: _embedded(own, names, images) for title, names in SECTIONS.items()}
    return {title: pictures for title, pictures in drawn.items() if pictures}


def _other(results: CandidateResults, figures: Figures, images: Images) -> dict[str, Any]:
    own = [figure for figure in figures if figure.candidate == results.name]
    return _candidate(results) | {
        "figures": _embedded(own, (*OF_OTHERS, "convergence"), images),
        "notices": [*notices.unconverged(results), *notices.of_candidate(results)],
    }


def _population(population: PopulationResults, figures: Figures, images: Images) -> dict[str, Any]:
    return {
        "name": population.name,
        "candidate": population.attributes["candidate"],
        "system": population.system,
        "provenance": population.provenance,
        "converged": population.converged,
        "members": population.members,
        "parameters": tables.population_parameters(population),
        "specimens": tables.specimens(population),
        "figures": _embedded(figures, OF_A_POPULATION, images),
    }


def _embedded(
    figures: Figures, names: Iterable[str], images: Images
) -> list[tuple[str, str, list[Image]]]:
    """(title, caption, sheets) of each named figure that was drawn."""
    drawn = ([figure for figure in figures if figure.name == name] for name in names)
    return [
        (sheets[0].title, sheets[0].caption, [images[sheet.png] for sheet in sheets])
        for sheets in drawn
        if sheets
    ]


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
