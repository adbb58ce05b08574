"""What `snakemake` says of a run: a line as each job begins and ends.

Snakemake finds this package by its name. `workflow/rules/running.smk` uses its `LogHandler` without
an option. Snakemake reads configuration files before it reads a Snakefile, and answers a missing
one with a traceback. So they are checked here, when the package is imported; only for a Snakefile
of deabayes.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

UNNAMED = ("all", "population_settings", "faults")
"""Rules whose jobs take no time, or only say what was said before."""
UNSAID = ("Assuming ", "Select jobs", "Using shell", "Singularity", "Touching ")
WIDEST = 200
"""Characters of a line of Snakemake's own messages, such as the plan of a dry run."""


class LogHandler(LogHandlerBase):
    """When, what became of a job, its rule, study and candidate; where its log is."""

    writes_to_stream, writes_to_file = True, False
    has_filter, has_formatter, needs_rulegraph = False, False, False

    def __post_init__(self) -> None:
        self.stream: TextIO = sys.stdout if self.common_settings.stdout else sys.stderr
        self.jobs: dict[int, str] = {}
        self.ended: list[int] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line about what happened to a job, or Snakemake's message."""
        event, said = getattr(record, "event", None), record.__dict__
        if event == LogEvent.JOB_INFO:
            rule, job = said["rule_name"], said["jobid"]
            if rule not in UNNAMED:
                self.jobs[job] = " ".join([rule, *said["wildcards"].values()])
                self._line("begins", job, *said["log"])
        elif event == LogEvent.JOB_ERROR:
            self._line("FAILED", said["jobid"], *said["log"])
        elif event == LogEvent.JOB_FINISHED:
            self.ended.append(said["job_id"])
        elif event == LogEvent.PROGRESS:
            for job in self.ended:
                self._line("done", job, f"{said['done']} of {said['total']} jobs")
            self.ended.clear()
        elif event in (None, LogEvent.RUN_INFO) or record.levelno >= logging.WARNING:
            text = record.getMessage()
            if not text.startswith(UNSAID) and "\nCalledProcessError in" not in text:
                self._write(text)

    def _line(self, state: str, job: int, *details: str) -> None:
        if job in self.jobs:
            now, name = time.strftime("%X"), self.jobs[job]
            self._write(f"{now}  {state:6}  {name:40}  {' '.join(details)}")

    def _write(self, text: str) -> None:
        self.stream.write(f"{text}\n")
        self.stream.flush()


class ShortLines(logging.Formatter):
    """Another formatter's text with long lines cut: a job may have hundreds of files."""

    def __init__(self, whole: logging.Formatter) -> None:
        super().__init__()
        self.whole = whole

    def format(self, record: logging.LogRecord) -> str:
        """Return the text of a record, with lines of at most `WIDEST` characters."""
        lines = str(self.whole.format(record)).split("\n")
        return "\n".join(x if len(x) <= WIDEST else f"{x[: WIDEST - 4]} ..." for x in lines)


def fault_of_config_files(arguments: Sequence[str]) -> str:
    """Say which `--configfile` of a deabayes run cannot be read; empty if all can.

    Parameters
    ----------
    arguments : of `snakemake`, without the command itself.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--configfile", "--configfiles", nargs="+", action="extend", default=[])
    parser.add_argument("--snakefile", "-s", default="Snakefile")
    try:
        given, _ = parser.parse_known_args(arguments)
    except argparse.ArgumentError:  # Snakemake says the same of it
        return ""
    snakefile = Path(given.snakefile)
    if not (snakefile.is_file() and "deabayes" in snakefile.read_text(encoding="utf-8")):
        return ""
    from deabayes.faults import UserError
    from deabayes.records.schema import read_yaml

    for file in given.configfile:
        try:
            read_yaml(Path(file))
        except (UserError, OSError) as error:
            if file == given.configfile[0] or Path(file).suffix in (".yaml", ".yml", ".json"):
                return str(error)
            return (
                f"{file}: is taken for a configuration file, as is all that follows --configfile; "
                f"write a target before it: snakemake --cores 2 {file} "
                f"--configfile {given.configfile[0]}"
            )
    return ""


if "snakemake" in Path(sys.argv[0]).parts[-2:] and (_fault := fault_of_config_files(sys.argv[1:])):
    print(_fault, file=sys.stderr)
    sys.exit(1)
