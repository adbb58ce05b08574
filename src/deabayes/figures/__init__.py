"""Registry of the figures, which are drawn from results files; each figure has its own module.

Figures of a paper's results are in the package `papers`.

A figure module defines `SCOPE` (candidate | study | population), `TITLE`, `CAPTION` and
`draw(results)`. `draw` takes a `CandidateResults`, a `StudyResults` or a `PopulationResults`
and returns a list of figures, one per sheet. A module that draws an analysis names it in
`ANALYSIS`, and defines `draw(results, analysis)`; it is called only if the analysis was computed.
A module for particular systems lists them in `SYSTEMS`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from deabayes.faults import UserError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from deabayes.figures.results import CandidateResults, PopulationResults, StudyResults

    Results = CandidateResults | StudyResults | PopulationResults

REGISTRY: Mapping[str, str] = {
    "data_and_bands": "deabayes.figures.data_and_bands",
    "residuals": "deabayes.figures.residuals",
    "marginals": "deabayes.figures.marginals",
    "identifiability": "deabayes.figures.identifiability",
    "pairs": "deabayes.figures.pairs",
    "convergence": "deabayes.figures.convergence",
    "coverage": "deabayes.figures.coverage",
    "pit": "deabayes.figures.pit",
    "noise_share": "deabayes.figures.noise_share",
    "prior_predictive": "deabayes.figures.prior_predictive",
    "prior_curves": "deabayes.papers.membrane.prior_curves",
    "one_at_a_time": "deabayes.papers.membrane.one_at_a_time",
    "one_at_a_time_loops": "deabayes.papers.membrane.one_at_a_time_loops",
    "sobol_indices": "deabayes.papers.membrane.sobol_indices",
    "comparison": "deabayes.figures.comparison",
    "further_experiments": "deabayes.figures.further_experiments",
    "errors": "deabayes.figures.errors",
    "preparation": "deabayes.figures.preparation",
    "frequency_response": "deabayes.papers.tubular.frequency_response",
    "strain_voltage": "deabayes.papers.tubular.strain_voltage",
    "error_against_time": "deabayes.papers.membrane.error_against_time",
    "response_stages": "deabayes.papers.membrane.response_stages",
    "force_curve": "deabayes.papers.minimum_energy_structure.force_curve",
    "structure_film": "deabayes.papers.minimum_energy_structure.structure_film",
    "genetic_algorithm": "deabayes.papers.minimum_energy_structure.genetic_algorithm",
    "structure_errors": "deabayes.papers.minimum_energy_structure.structure_errors",
    "structure_loops": "deabayes.papers.minimum_energy_structure.structure_loops",
    "hysteresis": "deabayes.papers.hysteresis",
    "error_against_phase": "deabayes.papers.minimum_energy_structure.error_against_phase",
    "structure_amplitude": "deabayes.papers.minimum_energy_structure.structure_amplitude",
    "amplitude_frequency": "deabayes.papers.membrane.amplitude_frequency",
    "pull_in": "deabayes.papers.membrane.pull_in",
    "shrinkage": "deabayes.figures.shrinkage",
    "new_specimen": "deabayes.figures.new_specimen",
}
"""Module of each figure, in the order of the report."""

OF_OTHERS = ("data_and_bands", "residuals", "marginals")
"""Figures of candidates that are not recommended; unconverged ones also get `convergence`."""
INDEX = "index.json"
FILES = ("svg", "png", "pdf")


@dataclass(frozen=True)
class SavedFigure:
    """One sheet of a figure, saved on disk.

    `candidate` is empty for a figure of a whole study or population. `analysis` names the
    analysis that the figure draws, and is empty if it draws none.
    """

    name: str
    candidate: str
    sheet: int
    title: str
    caption: str
    svg: Path
    png: Path
    pdf: Path
    analysis: str = ""


def module(name: str) -> ModuleType:
    """Return the module of a registered figure."""
    if name not in REGISTRY:
        raise UserError(f"no figure is called {name!r}{nearest(name, REGISTRY)}")
    return import_module(REGISTRY[name])


def names(scope: str) -> list[str]:
    """Registered figures of a scope (candidate | study | population)."""
    return [name for name in REGISTRY if scope == module(name).SCOPE]


def names_of(candidate: CandidateResults) -> list[str]:
    """Names of the figures drawn for a candidate, in the order of the registry."""
    every = names("candidate")
    if candidate is candidate.study.recommended:
        return every
    others = OF_OTHERS if candidate.converged else (*OF_OTHERS, "convergence")
    return [name for name in every if name in others]


def draw(name: str, results: Results, named: bool = False) -> list[Figure]:
    """Draw a registered figure with its mandatory marks.

    Figures from simulated data are marked as simulated. Figures of an unconverged candidate or
    population get a watermark. `named` writes the names of study and candidate above the axes.
    """
    from deabayes.figures import style
    from deabayes.figures.results import StudyResults

    with style.applied():
        figures = _drawn(module(name), results)
        for figure in figures:
            words = "  ·  ".join(_names(results)) if named else ""
            style.finish(figure, words, results.provenance == "simulated")
            if not isinstance(results, StudyResults) and not results.converged:
                style.watermark_unconverged(figure)
    return figures


def _names(results: Results) -> list[str]:
    """Names of the study, and of the candidate if the results are a candidate's."""
    return [results.study.name, *([] if results is results.study else [results.name])]


def _drawn(source: ModuleType, results: Results) -> list[Figure]:
    """Figures of a module; none for another system, or if its analysis was not computed."""
    if hasattr(source, "ANALYSIS"):
        analysis = results.study.analysis(source.ANALYSIS)  # type: ignore[union-attr]
        return source.draw(results, analysis) if analysis else []
    systems = getattr(source, "SYSTEMS", ())
    return source.draw(results) if not systems or results.study.system in systems else []


def save_all(study_folder: str | Path, out: str | Path, named: bool = False) -> list[SavedFigure]:
    """Draw the figures of a study and its candidates as SVG, PDF and PNG (300 dpi).

    The study and the recommended candidate get all registered figures, other candidates get
    `OF_OTHERS`. Files are `{figure}[_{sheet}].svg` for the study and
    `{candidate}_{figure}[_{sheet}].svg` for a candidate; `index.json` lists them. `study_folder`
    may also be the folder of a population (`results/populations/NAME`). A population has its own
    figures. `named` writes the names of study and candidate into the drawings; they always are
    in the files' metadata.

    Raises
    ------
    ExceptionGroup
        Names the figures that failed. It is raised after all other figures were drawn, and
        `index.json` is not written.
    """
    from deabayes.figures.results import PopulationResults, results_of

    whole, out = results_of(Path(study_folder)), Path(out)
    scope = "population" if isinstance(whole, PopulationResults) else "study"
    candidates = () if isinstance(whole, PopulationResults) else whole.candidates  # may raise
    out.mkdir(parents=True, exist_ok=True)
    (out / INDEX).unlink(missing_ok=True)
    wanted: list[tuple[str, Results]] = [(name, whole) for name in names(scope)]
    wanted += [(name, each) for each in candidates for name in names_of(each)]
    saved = _save_each(wanted, out, named)
    entries = [asdict(s) | {kind: getattr(s, kind).name for kind in FILES} for s in saved]
    (out / INDEX).write_text(json.dumps(entries, indent=1), encoding="utf-8")
    return saved


def _save_each(wanted: Sequence[tuple[str, Results]], out: Path, named: bool) -> list[SavedFigure]:
    """Draw and save all figures; raise a UserError at once, all other errors at the end."""
    saved: list[SavedFigure] = []
    failures: dict[str, Exception] = {}
    for name, results in wanted:
        try:
            saved += _save(name, results, out, named)
        except UserError:
            raise
        except Exception as error:
            if isinstance(error, FileNotFoundError) and Path(error.filename).parent == out:
                raise UserError(
                    f"{out}: was removed while figures were drawn, as a run of Snakemake does "
                    "before its own; wait for its end (`deabayes status`) and try again"
                ) from None
            failures[f"{name} of {results.name}"] = error
    if failures:
        raise ExceptionGroup(f"figures that failed: {', '.join(failures)}", [*failures.values()])
    return saved


def saved_figures(study_folder: Path, out: Path) -> list[SavedFigure] | None:
    """Figures that `save_all` wrote into `out`; None if there are none or the results are newer.

    Figures of an older version, which wrote no PDF, count as none.
    """
    from deabayes.figures.results import results_of

    index = out / INDEX
    if not index.is_file():
        return None
    drawn = index.stat().st_mtime
    if any(path.stat().st_mtime >= drawn for path in results_of(study_folder).inputs):
        return None
    entries = json.loads(index.read_text(encoding="utf-8"))
    if not all(entry.keys() >= set(FILES) for entry in entries):
        return None
    return [SavedFigure(**e | {kind: out / e[kind] for kind in FILES}) for e in entries]


def _save(name: str, results: Results, out: Path, named: bool) -> list[SavedFigure]:
    from deabayes.figures import style

    source = module(name)
    # a paper's module has one title for its table and one for its figure
    title, caption = (getattr(source, f"FIGURE_{n}", None) or getattr(source, n)
                      for n in ("TITLE", "CAPTION"))  # fmt: skip
    candidate = "" if results is results.study else results.name
    figures, keywords = draw(name, results, named), _names(results)
    saved = []
    for sheet, figure in enumerate(figures, start=1):
        stem = "_".join(filter(None, (candidate, name, str(sheet) if len(figures) > 1 else "")))
        number = [f"sheet {sheet}"] if len(figures) > 1 else []
        with style.applied():
            style.write(figure, out / stem, ", ".join([title, *keywords, *number]), keywords)
        svg, png, pdf = (out / f"{stem}.{kind}" for kind in FILES)
        analysis = getattr(source, "ANALYSIS", "")
        saved.append(SavedFigure(name, candidate, sheet, title, caption, svg, png, pdf, analysis))
    return saved
