"""The report of a run in which jobs failed: what is there is shown, what is missing is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.pipeline.analyse import analyse_study
from deabayes.pipeline.judge import compare_candidates
from deabayes.pipeline.publish import build_report, draw_figures

if TYPE_CHECKING:
    from deabayes.report.notices import Notice

FITTED = ("posterior.nc", "summary.csv", "scores.json", "errors.csv")
"""What a candidate must have to be shown."""
LONGEST_MESSAGE = 600


def finish(state: Path, output: Path, tables: Path) -> None:
    """Build the report of a run in which jobs failed.

    Parameters
    ----------
    state : JSON that the workflow writes: `failed` jobs (`stage`, `study`, `candidate`,
        `population`, `log`), the files `made` and up to date by results folder, `left_out` studies.
        Candidates that are complete are compared and drawn in a folder beside it.
    output, tables : the report's page and folder of tables.
    """
    content = json.loads(state.read_text(encoding="utf-8"))
    failed = [_notice(**job) for job in content["failed"]]
    folders = []
    for folder, files in content["made"].items():
        made = [Path(file) for file in files]
        if Path(folder, "figures") in made:
            folders.append(Path(folder))
            continue
        shown, missing = _shown_in_part(Path(folder), made, state.with_suffix(""))
        folders += shown
        known = {notice.study for notice in failed}
        failed += missing if Path(folder).name in known or shown else _not_run(Path(folder))
    build_report(folders, output, tables, content["left_out"], failed)


def _notice(stage: str, study: str, candidate: str, population: str, log: str) -> Notice:
    """That a job failed, the end of what it said, and where all of it is."""
    from deabayes.report.notices import Notice

    path = Path(log)
    said = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    lines = [line for line in said.replace("\r", "\n").splitlines() if line.strip()]
    details = (*(line[:LONGEST_MESSAGE] for line in lines[-1:]), f"log: {log}")
    return Notice(study or population, candidate, f"Failed: {stage}", details)


def _not_run(folder: Path) -> list[Notice]:
    from deabayes.report.notices import Notice

    return [Notice(folder.name, "", "Not run", ("it needs results of what failed elsewhere",))]


def _shown_in_part(
    folder: Path, made: Sequence[Path], place: Path
) -> tuple[list[Path], list[Notice]]:
    """The results folder of the candidates that are complete, none if there are none.

    Also a notice on each stage that could not be run for them.
    """
    there = set(made)
    complete = [
        path.parent.name
        for path in made
        if path.name == FITTED[0] and there.issuperset(path.with_name(name) for name in FITTED)
    ]
    if not complete or folder / "prepared" not in there:
        return [], []
    shown = place / folder.name
    _link(folder, made, complete, shown)
    missing = list(_run_stages(shown, complete))
    drawn = (shown / "figures" / "index.json").is_file()
    return [shown] if drawn else [], missing


def _link(folder: Path, made: Iterable[Path], complete: Sequence[str], shown: Path) -> None:
    """Links to what is made of the complete candidates and of the study, and its settings."""
    from deabayes.studies import load_study, write_study

    shutil.rmtree(shown, ignore_errors=True)
    of_study = {"prepared", "comparison.csv", "further_experiments.csv", "analyses"}
    for path in made:
        if path.parent.name in complete or (path.parent == folder and path.name in of_study):
            link = shown / path.relative_to(folder)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(path.resolve())
    study = load_study(folder / "study.yaml")
    kept = tuple(name for name in study.candidates if name in complete)
    write_study(replace(study, candidates=kept), shown / "study.yaml")


def _run_stages(shown: Path, complete: Sequence[str]) -> Iterable[Notice]:
    """Run what is missing in a study's folder; a notice on each stage that fails."""
    from deabayes.report.notices import Notice

    posteriors = [shown / name / FITTED[0] for name in complete]
    stages: dict[str, Callable[[Path], object]] = {
        "comparison.csv": lambda path: compare_candidates(posteriors, shown / "prepared", path),
        "analyses": lambda path: analyse_study(shown, path),
        "figures": lambda path: draw_figures(shown, path),
    }
    for name, run in stages.items():
        if not (shown / name).exists():
            try:
                run(shown / name)
            except Exception as error:
                said = f"{type(error).__name__}: {error}"
                yield Notice(shown.name, "", f"Not made: {name}", (said[:LONGEST_MESSAGE],))
