"""Fill the page's template from results, and shrink the figures to embed them."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.figures import OF_OTHERS, SavedFigure
from deabayes.figures.results import CandidateResults, PopulationResults, StudyResults
from deabayes.prediction.errors import rejected
from deabayes.report import notices, sections, tables

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

QUALITIES = ((1300, 96), (1000, 64), (800, 32))
"""Width in pixels and number of colours, tried in turn until the page is small enough."""
DOUBLE_COLUMN = 2161
"""Width in pixels of a double-column figure at 300 dpi."""
SAMPLED = 3
"""Step in pixels, in both directions, of the samples from which rarer colours are found."""
LARGEST = 13_000_000
"""Largest size of all sheets in bytes; mail servers often refuse more than 20 MB encoded."""
TRIED, FAR_TOO_LARGE = 8, 1.4
"""Every `TRIED`-th sheet is scaled first, to estimate the size of all sheets. The others are
skipped if the estimate exceeds `FAR_TOO_LARGE` times `LARGEST`."""
THREADS = 2
"""Threads that scale sheets; nothing else runs while the report is made."""


@dataclass(frozen=True)
class Image:
    """An embedded sheet; `width` and `height` in CSS pixels reserve its space on the page."""

    source: str
    width: int
    height: int
    text: str


def embed_all(figures: Sequence[SavedFigure]) -> dict[Path, Image]:
    """Return the embedded sheets by PNG path, in the best quality that fits in `LARGEST`."""
    images: list[Image] = []
    with ThreadPoolExecutor(THREADS) as pool:
        for width, colours in QUALITIES:
            embedded = partial(embed, width=width, colours=colours)
            tried = TRIED * _size(pool.map(embedded, figures[::TRIED]))
            if tried > FAR_TOO_LARGE * LARGEST and (width, colours) != QUALITIES[-1]:
                continue
            images = list(pool.map(embedded, figures))
            if _size(images) <= LARGEST:
                break
    return {figure.png: image for figure, image in zip(figures, images, strict=True)}


def _size(images: Iterable[Image]) -> int:
    return sum(len(image.source) for image in images)


def embed(figure: SavedFigure, width: int, colours: int) -> Image:
    """Embed the PNG of a saved sheet as a data URI, scaled down and with few colours."""
    data, size = shrink(figure.png, width, colours)
    scale = 900 / DOUBLE_COLUMN
    return Image(
        "data:image/png;base64," + base64.b64encode(data).decode("ascii"),
        round(size[0] * scale),
        round(size[1] * scale),
        " ".join(filter(None, (figure.title, figure.candidate))),
    )


def shrink(path: Path, width: int, colours: int) -> tuple[bytes, tuple[int, int]]:
    """Return the bytes of a smaller PNG with a palette, and the size of the original.

    A double-column figure becomes at most `width` pixels wide. A figure has few colours, so a
    palette costs nothing visible and saves two thirds. The palette holds the exact colours of
    areas, so that areas and legend agree.
    """
    from PIL import Image as Pictures

    with Pictures.open(path) as opened:
        picture, size = opened.convert("RGB"), opened.size
    factor = min(width / DOUBLE_COLUMN, 1.0)
    if factor < 1.0:
        smaller = (round(size[0] * factor), round(size[1] * factor))
        picture = picture.resize(smaller, Pictures.Resampling.HAMMING)
    picture = picture.quantize(palette=_palette(picture, colours), dither=Pictures.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG")
    return buffer.getvalue(), size


def _palette(picture: Picture, colours: int) -> Picture:
    """Palette of the most frequent colours (half of the palette) and medians of all colours."""
    from PIL import Image as Pictures

    counted = picture.getcolors(picture.width * picture.height) or []
    frequent = sorted(counted, reverse=True)[: colours // 2]
    left = colours - len(frequent)
    size = (-(-picture.width // SAMPLED), -(-picture.height // SAMPLED))
    sampled = picture.resize(size, Pictures.Resampling.NEAREST)
    medians = sampled.quantize(left, Pictures.Quantize.MEDIANCUT).getpalette() or []
    palette = Pictures.new("P", (1, 1))
    areas = np.array([colour for _, colour in frequent]).ravel().tolist()
    palette.putpalette(areas + medians[: 3 * left])
    return palette


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
    found = [notice for study in studies for notice in notices.of_study(study)]
    found += [notice for each in populations_ for notice in sections.population_notices(each)]
    shown = {s.name for s in studies} | {each.name for each in populations_}
    return template.render(
        css=(folder / "style.css").read_text(encoding="utf-8"),
        studies=[_study(s, figures[s.folder], images) for s in studies],
        populations=[
            sections.population_section(each)
            | {"figures": _embedded(figures[each.folder], sections.FIGURES, images)}
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
    """Figure folders, with `<study>` or `<population>` in place of the names."""
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
        "comparison": sections.order_rows(study),
        "nested": sections.asked_for_nested(study),
        "may_hide": sections.may_hide(study),
        "comparison_figures": _embedded(of_study, ("comparison",), images),
        "further": sections.further_sentence(study),
        "further_rows": sections.further_rows(study),
        "further_figures": _embedded(of_study, ("further_experiments",), images),
        "errors_figures": _embedded(of_study, ("errors",), images),
        "analyses": _analyses(study, figures, images),
        "preparation_figures": _embedded(figures, ("preparation",), images),
        "best": _candidate(best, figures, images),
        "others": [_other(c, figures, images) for c in study.candidates if c is not best],
    }


def _analyses(study: StudyResults, figures: Figures, images: Images) -> list[dict[str, Any]]:
    """Sections of the analyses, each with its figures and tables; empty ones are left out."""
    shown = {"", study.recommended.name}
    readable = sections.analysis_tables(study)
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
    """State which candidate to use, and whether its calibration records reject it."""
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
    drawn = [(title, _embedded(own, names, images)) for title, names in SECTIONS]
    return _common(results) | {
        "sections": {title: pictures for title, pictures in drawn if pictures},
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
