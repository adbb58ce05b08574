"""Fill the page's template from results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from deabayes.figures import OF_OTHERS, SavedFigure
from deabayes.figures.population_results import PopulationResults
from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.prediction.held_out import rejected
from deabayes.report import analyses, further, notices, orders, populations, tables
from deabayes.report.images import Image

PACKAGES = ("deabayes", "numpy", "scipy", "numba", "emcee", "xarray", "arviz-stats", "matplotlib")
SECTIONS = (
    ("Data and predictions", ("data_and_bands",)),
    ("Residuals", ("residuals", "noise_share", "coverage", "pit")),
    ("Parameters", ("marginals", "identifiability", "pairs")),
    ("Convergence", ("convergence",)),
    ("Prior", ("prior_predictive",)),
)

Figures = Sequence[SavedFigure]
Images = Mapping[Path, Image]


def render(
    studies: Sequence[StudyResults],
    figures: Mapping[Path, Figures],
    left_out: Sequence[str],
    images: Images,
    populations_: Sequence[PopulationResults] = (),
    tables_folder: Path = Path("tables"),
    failed: Sequence[notices.Notice] = (),
) -> str:
    """The page as HTML.

    Parameters
    ----------
    figures : those of every results folder.
    images : sheet -> as it is embedded.
    failed : what is missing.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    folder = files("deabayes.report")
    template = environment.from_string((folder / "template.html").read_text(encoding="utf-8"))
    found = [notice for study in studies for notice in notices.of_study(study)]
    found += [notice for each in populations_ for notice in populations.notices(each)]
    shown = {s.name for s in studies} | {each.name for each in populations_}
    return template.render(
        css=(folder / "style.css").read_text(encoding="utf-8"),
        studies=[_study(s, figures[s.folder], images) for s in studies],
        populations=[
            populations.section(each)
            | {"figures": _embedded(figures[each.folder], populations.FIGURES, images)}
            for each in populations_
        ],
        serious=[n for n in found if n.serious],
        notes=[n for n in found if not n.serious],
        left_out=list(left_out),
        failed=failed,
        without_results=sorted({n.study for n in failed} - shown - {""}),
        tables_folder=tables_folder.as_posix(),
        figure_folders=figure_folders(studies, populations_),
        versions=_versions(studies),
        built=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def figure_folders(
    studies: Sequence[StudyResults], populations_: Sequence[PopulationResults]
) -> list[str]:
    """Where the figures of all are, with a word in place of a name."""
    named = [(each.folder, "<study>") for each in studies]
    named += [(each.folder, "<population>") for each in populations_]
    places = ((folder if folder.name else folder.resolve(), word) for folder, word in named)
    return list(dict.fromkeys((f.parent / word / "figures").as_posix() for f, word in places))


def _study(study: StudyResults, figures: Figures, images: Images) -> dict[str, Any]:
    best = study.recommended
    specimen = best.attributes.get("specimen") or {}
    of_study = [f for f in figures if not f.candidate]
    return {
        "name": study.name,
        "provenance": study.provenance,
        "source": (specimen.get("provenance") or {}).get("source", ""),
        "specimen": specimen.get("name", ""),
        "system": best.attributes.get("system", ""),
        "noise": best.attributes.get("noise", ""),
        "verdict": verdict(study),
        "records": tables.records(study),
        "comparison": orders.order_rows(study),
        "nested": orders.asked_for_nested(study),
        "may_hide": orders.may_hide(study),
        "comparison_figures": _embedded(of_study, ("comparison",), images),
        "further": further.sentence(study),
        "further_rows": further.further_rows(study),
        "further_figures": _embedded(of_study, ("further_experiments",), images),
        "errors_figures": _embedded(of_study, ("errors",), images),
        "analyses": _analyses(study, figures, images),
        "preparation_figures": _embedded(figures, ("preparation",), images),
        "best": _candidate(best, figures, images),
        "others": [_other(c, figures, images) for c in study.candidates if c is not best],
    }


def _analyses(study: StudyResults, figures: Figures, images: Images) -> list[dict[str, Any]]:
    """What the paper of the system reports: each analysis with its figures and tables, if any."""
    shown = {"", study.recommended.name}
    readable = analyses.tables(study)
    found = []
    for each in study.analyses:
        own = [f for f in figures if f.analysis == each.name and f.candidate in shown]
        if not own and not readable[each.name]:
            continue
        names = list(dict.fromkeys(figure.name for figure in own))
        found.append(
            {
                "title": each.title,
                "caption": each.caption,
                "figures": _embedded(own, names, images),
                "tables": readable[each.name],
            }
        )
    return found


def verdict(study: StudyResults) -> str:
    """Which candidate to use, and whether the records that it was fitted to reject it."""
    best = study.recommended
    lost = [] if best.errors is None else list(rejected(best.errors)["experiment"])
    if not lost:
        return _choice(study)
    return (
        f"{_choice(study)} But the records it was fitted to reject it ({', '.join(lost)}): "
        "something in them is in none of these models, and parameters may be off by more than said."
    )


def _choice(study: StudyResults) -> str:
    """One sentence on which candidate to use."""
    best, count = study.recommended, len(study.candidates)
    if not any(c.converged for c in study.candidates):
        return "No candidate converged, so none is to be used: sample longer."
    if study.comparison is None and count > 1:
        return f"{count} candidates were fitted and not compared; {best.name} is shown."
    if study.comparison is None or count < 2:
        return f"One candidate was fitted, {best.name}; there was no order to choose."
    text = str(study.comparison["verdict"].get(best.name, "not compared"))
    if text.startswith("nothing to compare"):
        return (
            f"Only {best.name} of {count} candidates converged, so no order can be chosen; "
            "it is shown, not recommended."
        )
    if text.startswith("not resolved"):
        return f"The records do not settle the model order; {best.name} is shown ({text})."
    return f"Of {count} candidates, use {best.name}: {text.removeprefix('chosen: ')}."


def _candidate(results: CandidateResults, figures: Figures, images: Images) -> dict[str, Any]:
    own = [f for f in figures if f.candidate == results.name]
    sections = [(title, _embedded(own, names, images)) for title, names in SECTIONS]
    return _common(results) | {
        "sections": {title: pictures for title, pictures in sections if pictures},
        "errors": tables.errors(results),
        "parameters": tables.parameters(results),
    }


def _other(results: CandidateResults, figures: Figures, images: Images) -> dict[str, Any]:
    own = [f for f in figures if f.candidate == results.name]
    return _common(results) | {
        "figures": _embedded(own, (*OF_OTHERS, "convergence"), images),
        "errors": tables.errors(results),
        "parameters": tables.parameters(results),
        "notices": [*notices.unconverged(results), *notices.of_candidate(results)],
    }


def _common(results: CandidateResults) -> dict[str, Any]:
    convergence = results.convergence
    return {
        "name": results.name,
        "converged": results.converged,
        "effort": [
            (text, convergence[key])
            for key, text in (
                ("ensembles", "independent runs"),
                ("walkers", "walkers each"),
                ("steps", "steps"),
            )
            if key in convergence
        ],
    }


def _embedded(
    figures: Figures, names: Sequence[str], images: Images
) -> list[tuple[str, str, list[Image]]]:
    """(title, caption, sheets) of each named figure that was drawn."""
    found = []
    for name in names:
        sheets = [f for f in figures if f.name == name]
        if sheets:
            pictures = [images[sheet.png] for sheet in sheets]
            found.append((sheets[0].title, sheets[0].caption, pictures))
    return found


def _versions(studies: Sequence[StudyResults]) -> dict[str, str]:
    known = {}
    for package in PACKAGES:
        try:
            known[package] = version(package)
        except PackageNotFoundError:
            continue
    fitted = {str(c.attributes.get("deabayes_version", "")) for s in studies for c in s.candidates}
    stale = sorted(fitted - {known.get("deabayes", ""), ""})
    return known | ({"fitted with deabayes": ", ".join(stale)} if stale else {})
