"""Build the report: one self-contained page about studies, made only from results files.

`tables` makes the rows of all tables, `notices` the warnings, and `words` all other sentences.
`cards` chooses from them what the first screen shows. `images` shrinks the printed figures, and
`interactive` makes the ones to zoom into. `contents` gives all of it to the templates in `page`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
    from deabayes.report.contents import Place, render, shown
    from deabayes.report.images import embed_all
    from deabayes.report.tables import write_csv

    results = [results_of(Path(folder)) for folder in study_folders]
    studies = [one for one in results if isinstance(one, StudyResults)]
    populations = [one for one in results if isinstance(one, PopulationResults)]
    _check_names(studies)
    _check_names(populations)
    figures = {one.folder: _figures(one.folder) for one in results}  # may raise: before writing
    write_csv(studies, Path(tables_folder), populations)
    sheets = [sheet for one in results for sheet in shown(figures[one.folder], one)]
    images = embed_all(sheets, Path(output))
    place = Place(Path(output), Path(tables_folder))
    page = render(studies, figures, left_out, images, place, populations, failed)
    write_text_atomically(page, Path(output))
    return Path(output)


def _check_names(results: Iterable[StudyResults | PopulationResults]) -> None:
    """Check that names are unique, because sections and tables are named after them."""
    folders: dict[str, Path] = {}
    for one in results:
        if one.name in folders:
            raise UserError(
                f"{folders[one.name]} and {one.folder}: both are called {one.name!r}, and so are "
                "their tables; make two reports"
            )
        folders[one.name] = one.folder


def _figures(folder: Path) -> list[SavedFigure]:
    from deabayes.figures import save_all, saved_figures

    existing = saved_figures(folder, folder / "figures")
    return save_all(folder, folder / "figures") if existing is None else existing
