"""What a run is doing, what is done and what is left, from the files and logs of the results."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from deabayes.faults import UserError
from deabayes.pipeline.prepare import select_rows
from deabayes.records.folder import read_folder
from deabayes.study import Study

DONE, RUNNING, FAILED, BEGUN, LEFT = "done", "running", "FAILED", "begun, not running", "left"
OF_CANDIDATE = {"fit": "posterior.nc", "score": "scores.json", "predict": "errors.csv"}
"""Stages of a candidate and a file that each makes."""
OF_STUDY = {
    "preview": "preview",
    "compare": "comparison.csv",
    "further_experiments": "further_experiments.csv",
    "analyse": "analyses",
    "figures": "figures",
}
"""Stages of a study, and what each makes."""
JOB = re.compile(r"^(?:local)?rule \w+:\n((?:    .*\n)+)", re.MULTILINE)
ENDED = re.compile(r"^Finished jobid: (\d+)", re.MULTILINE)
ERROR = re.compile(r"^Error in rule \w+:\n(?:    .*\n)*?    jobid: (\d+)", re.MULTILINE)
STEPS = re.compile(r"^(\d+ of \d+) steps", re.MULTILINE)
JOB_ID, LOG = re.compile(r"^    jobid: (\d+)", re.MULTILINE), re.compile(r"^    log: (.*)", re.M)


@dataclass(frozen=True)
class Run:
    """The last run of Snakemake in a folder.

    Attributes
    ----------
    going_on : whether the run holds the folder's lock, as a run does that was killed.
    steps : how far it is, such as ``3 of 17``; empty if unknown.
    jobs : log of each job of the run, seen from the working directory -> its state.
    """

    going_on: bool = False
    steps: str = ""
    jobs: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def last(cls, place: Path) -> Run:
        """Read Snakemake's own log of the last run in the folder `place`."""
        logs = sorted((place / ".snakemake" / "log").glob("*.snakemake.log"))
        if not logs:
            return cls()
        text = logs[-1].read_text(encoding="utf-8", errors="replace")
        going_on = any((place / ".snakemake" / "locks").glob("*"))
        ended = dict.fromkeys(ENDED.findall(text), DONE) | dict.fromkeys(
            ERROR.findall(text), FAILED
        )
        jobs = {}
        for block in JOB.findall(text):
            job, log = JOB_ID.search(block), LOG.search(block)
            if job and log:
                jobs[log[1]] = ended.get(job[1], RUNNING if going_on else BEGUN)
        return cls(going_on, ["", *STEPS.findall(text)][-1], jobs)

    def state(self, made: Path, log: Path) -> str:
        """State of a job, by what it makes and its log."""
        of_run = self.jobs.get(log.as_posix())
        if of_run in (RUNNING, FAILED):
            return of_run
        if made.exists():
            return DONE
        return BEGUN if log.exists() else LEFT

    def in_words(self) -> str:
        """Return a sentence on the run."""
        if not self.going_on:
            return "No run is going on."
        running = sum(state == RUNNING for state in self.jobs.values())
        return (
            f"A run is going on: {self.steps or 'none'} jobs done, {running} running. "
            "(If it was killed: snakemake --unlock.)"
        )


def status(studies: Mapping[str, Study], results: Path, run: Run) -> Iterator[str]:
    """Yield lines on each study and candidate, then on the report."""
    for study in studies.values():
        yield from ("", f"{study.name}: {'; '.join(_of_study(study, results / study.name, run))}")
        for candidate in study.candidates:
            yield f"  {candidate:24} {_of_candidate(results / study.name / candidate, run)}"
    page = results / "report" / "index.html"
    yield ""
    yield f"Report: {page if page.is_file() else 'not made yet'}"


def _of_study(study: Study, folder: Path, run: Run) -> Iterator[str]:
    """Yield the states of the stages of a study, done ones together."""
    yield _records(study, folder / "prepared")
    states = {
        stage: run.state(folder / made, folder / "logs" / f"{stage}.log")
        for stage, made in OF_STUDY.items()
    }
    yield from _by_state(states)


def _records(study: Study, prepared: Path) -> str:
    try:
        rows = select_rows(study, read_folder(study.specimen, study.data_root, False).table)
    except UserError as error:
        return f"at fault ({str(error).splitlines()[0]})"
    there = sum((prepared / f"{row.name}.nc").is_file() for row in rows)
    return f"{there} of {len(rows)} records prepared"


def _of_candidate(folder: Path, run: Run) -> str:
    states = {
        stage: run.state(folder / made, folder / "logs" / f"{stage}.log")
        for stage, made in OF_CANDIDATE.items()
    }
    fit = states.pop("fit")
    if fit == LEFT and (folder / ".chain").is_dir():
        fit = BEGUN
    said = "" if fit == LEFT else _last_line(folder / "logs" / "fit.log")
    if fit == DONE:
        said = _convergence(folder / "summary.csv")
    words = [f"fit {fit}{f' ({said})' if said else ''}"]
    return "; ".join([*words, *(_by_state(states) if fit == DONE else ())])


def _by_state(states: Mapping[str, str]) -> Iterator[str]:
    """Yield stages by their state, such as ``compare, figures left``."""
    for state in dict.fromkeys(states.values()):
        yield f"{', '.join(stage for stage in states if states[stage] == state)} {state}"


def _convergence(summary: Path) -> str:
    """Say whether a candidate converged, as its summary.csv says; empty without one."""
    if not summary.is_file():
        return ""
    with summary.open(newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file), {})
    known = {"true": "converged", "false": "NOT converged"}
    return known.get(str(row.get("converged")).lower(), "")


def _last_line(log: Path) -> str:
    """Return the last line of a log: the sampler's progress, or why a job failed."""
    if not log.is_file():
        return ""
    lines = log.read_text(encoding="utf-8", errors="replace").replace("\r", "\n").splitlines()
    return next((line.strip()[:160] for line in reversed(lines) if line.strip()), "")
