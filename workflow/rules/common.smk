"""The studies that can run, checked by name before the first job."""

import os
import re
import sys
from pathlib import Path

from deabayes.faults import Faults, UserError
from deabayes.population.checks import check_population
from deabayes.population.settings import load_populations
from deabayes.checks.prior_sources import Sources
from deabayes.pipeline.sources import digest_of
from deabayes.records.download import missing_data
from deabayes.studies import load_studies
from deabayes.checks.study import check_names

CONFIG_FILES = ", ".join(config_files())

# One thread per job, also in libraries of linear algebra: parallelism is over jobs.
# `logged LOG COMMAND`: what the command says is in its log and, where it failed, also shown.
shell.prefix(
    "set -euo pipefail; "
    "export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1; "
    'logged() {{ local log=$1; shift; "$@" > "$log" 2>&1 || '
    "{{ tail -c 4000 \"$log\" | tr '\\r' '\\n' | tail -n 20 >&2; exit 1; }}; }}; "
)


def read_studies():
    """The studies with records at hand, a line on each folder left out, the names of its studies."""
    at_hand, left_out = {}, {}
    for study in load_studies(settings_given(), CONFIG_FILES):
        missing = missing_data(study.specimen, study.data_root)
        if missing:
            left_out.setdefault(missing, []).append(study.name)
        else:
            at_hand[study.name] = study
    lines = [f"{few(names)} left out: {why}" for why, names in left_out.items()]
    return at_hand, lines, [name for names in left_out.values() for name in names]


def read_populations():
    """The populations whose studies can all be run, and a line on each that is left out."""
    at_hand, left_out = {}, []
    for population in load_populations(settings_given(), CONFIG_FILES):
        missing = [name for name in population.studies if name not in STUDIES]
        if missing:
            why = f"no records of {', '.join(missing)}"
            left_out.append(f"population {population.name} left out: {why}")
        else:
            at_hand[population.name] = population
    return at_hand, left_out


def few(names):
    """One name, or the first and how many more."""
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} like it"


def check(studies, populations, names_left_out):
    """Raise for every name in the configuration that nothing has, before the first job."""
    faults = [fault for study in studies.values() for fault in check_names(study)]
    for population in () if faults else populations.values():
        faults += check_population(population, studies)
    if not faults:
        results = Path(workflow.pathvars.items["results"])
        sources = Sources(studies, populations, results, names_left_out)
        faults = [
            fault for study in studies.values() for fault in sources.faults(study)
        ]
    if faults:
        raise Faults(list(dict.fromkeys(faults)))


try:
    STUDIES, LEFT_OUT, NAMES_LEFT_OUT = read_studies()
    POPULATIONS, left_out_too = read_populations()
    LEFT_OUT += left_out_too
    # Jobs read the Snakefile again; what was checked once need not be.
    if workflow.is_main_process:
        check(STUDIES, POPULATIONS, NAMES_LEFT_OUT)
except (UserError, OSError) as error:
    end(error)

if workflow.is_main_process:
    for line in LEFT_OUT:
        print(line, file=sys.stderr)


def any_of(names):
    """A pattern that matches these names and nothing else."""
    return "|".join(re.escape(name) for name in sorted(names)) or "none"


wildcard_constraints:
    study=any_of(STUDIES),
    population=any_of(POPULATIONS),
    candidate=any_of({name for study in STUDIES.values() for name in study.candidates}),
    record=r"[^/]+",
