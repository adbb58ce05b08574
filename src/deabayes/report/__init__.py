"""Build the report: one self-contained page about studies, made only from results files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.faults import UserError

if TYPE_CHECKING:
    from deabayes.figures import SavedFigure
    from deabayes.figures.results import PopulationResults, StudyResults
    from deabayes.report.notices import Notice


def build(
    study_folders: Sequence[str | Path],
    output: str | Path,
    tables_folder: str | Path,
    left_out: Sequence[str] = (),
    failed: Sequence[Notice] = (),
) -> Path:
    """Write the report page and its tables.

    Parameters
    ----------
    study_folders : `results/{study}` of every study to report, in the page's order, and
        `results/populations/{population}` of every population.
        Figures that `deabayes.figures.save_all` wrote to `{study}/figures` are used if they
        are newer than the results. Otherwise they are drawn first.
    output : the page, one HTML file without references to other files.
    tables_folder : folder for `{study}_{errors,summary,comparison}.csv` and tables of analyses.
    left_out : one sentence per study that was not run, with the way to get its data.
    failed : notices of the jobs that failed, with the paths of their logs.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    UserError
        If a folder holds no fitted candidate, or if two studies or two populations have the
        same name.
    """
    from deabayes.figures.results import PopulationResults, StudyResults, results_of
    from deabayes.files import write_text_atomically
    from deabayes.report import sections
    from deabayes.report.page import embed_all, render
    from deabayes.report.tables import write_csv

    found = [results_of(Path(folder)) for folder in study_folders]
    studies = [each for each in found if isinstance(each, StudyResults)]
    populations = [each for each in found if isinstance(each, PopulationResults)]
    _check_names(studies)
    _check_names(populations)
    figures = {each.folder: _figures(each) for each in found}  # may raise, before tables and page
    write_csv(studies, Path(tables_folder))
    sections.write_csv(populations, Path(tables_folder))
    images = embed_all([sheet for sheets in figures.values() for sheet in sheets])
    page = render(studies, figures, left_out, images, populations, Path(tables_folder), failed)
    output = Path(output)
    write_text_atomically(page, output)
    return output


def _check_names(found: Sequence[StudyResults | PopulationResults]) -> None:
    """Check that names are unique, because sections and tables are named after them."""
    folders: dict[str, Path] = {}
    for each in found:
        if each.name in folders:
            raise UserError(
                f"{folders[each.name]} and {each.folder}: both are called {each.name!r}, as are "
                "their tables; report them apart"
            )
        folders[each.name] = each.folder


def _figures(study: StudyResults | PopulationResults) -> list[SavedFigure]:
    from deabayes.figures import save_all, saved_figures

    existing = saved_figures(study.folder, study.folder / "figures")
    if existing is not None:
        return existing
    return save_all(study.folder, study.folder / "figures")
