"""The studies that can run, checked by name before the first job."""

import atexit
import contextlib
import io
import os
import re
import sys
from pathlib import Path

from deabayes.checks.config import check_config, load_config, only_asked
from deabayes.faults import Faults, UserError
from deabayes.pipeline.sources import digest_of
from snakemake.cli import parse_args

CONFIG_FILES = ", ".join(config_files())

# One thread per job, also in libraries of linear algebra: parallelism is over jobs.
# `logged LOG COMMAND`: what the command says is in its log and, where it failed, also shown.
shell.prefix(
    "set -euo pipefail; "
    "export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1; "
    'logged() {{ local log=$1; shift; "$@" > "$log" 2>&1 || '
    "{{ tail -c 4000 \"$log\" | tr '\\r' '\\n' | tail -n 20 >&2; exit 1; }}; }}; "
)


def targets_asked():
    """The targets of the command line, as Snakemake reads it; empty for the default target."""
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            return list(parse_args(sys.argv[1:])[1].targets)
        except SystemExit:  # called by a program with arguments of its own
            return []


def read_config():
    """The studies to run, with those asked for checked by name; ends if none of these can run."""
    found = load_config(settings_given(), CONFIG_FILES)
    # Jobs read the Snakefile again; what was checked once need not be.
    if workflow.is_main_process:
        of_studies = only_asked(found, TARGETS, RESULTS)
        check_config(found, RESULTS)
        if found.faults and (of_studies or not found.studies):
            raise Faults(found.faults_once())
    return found


RESULTS = Path(workflow.pathvars.items["results"])
TARGETS = targets_asked() if workflow.is_main_process else []
try:
    FOUND = read_config()
except (UserError, OSError) as error:
    end(error)
STUDIES, POPULATIONS, FAULTS = FOUND.studies, FOUND.populations, FOUND.faults
LEFT_OUT = [*FOUND.left_out, *FOUND.left_out_by_faults()]


def say_what_is_left_out():
    """Faults, and what is not run because of them or because of missing data."""
    lines = FOUND.faults_once()
    if FAULTS:
        lines.append(
            f"{', '.join(FAULTS)} left out because of these faults: correct them. The rest is run; "
            "then the run ends with status 1"
        )
    if FAULTS and workflow.output_settings.dryrun:
        atexit.register(end_with_status_1)  # no job is run that could fail
    for line in [*lines, *FOUND.left_out]:
        print(line, file=sys.stderr)


def end_with_status_1():
    """End this process, of which Snakemake would say that all is well."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1)


def any_of(names):
    """A pattern that matches these names and nothing else."""
    return "|".join(re.escape(name) for name in sorted(names)) or "none"


wildcard_constraints:
    study=any_of(STUDIES),
    population=any_of(POPULATIONS),
    candidate=any_of({name for study in STUDIES.values() for name in study.candidates}),
    record=r"[^/]+",
