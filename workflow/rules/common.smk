"""Configuration, the studies that can run, and the named input functions of the rules."""

import json
import os
import re
import sys
from pathlib import Path

import deabayes
import yaml
from deabayes.faults import Faults, UserError
from deabayes.population.checks import check_population
from deabayes.population.settings import load_populations
from deabayes.population.settings import to_settings as population_to_settings
from deabayes.checks.prior_sources import Sources
from deabayes.reading.download import missing_data
from deabayes.reading.folder import read_folder
from deabayes.study import fit_settings, load_studies
from deabayes.checks.study import check_names

PACKAGE = Path(os.path.relpath(Path(deabayes.__file__).parent))
CONFIG_FILES = ", ".join(config_files())

# `logged LOG COMMAND`: what the command says is in its log and, where it failed, also shown.
shell.prefix(
    'set -euo pipefail; logged() {{ local log=$1; shift; "$@" > "$log" 2>&1 || '
    "{{ tail -c 4000 \"$log\" | tr '\\r' '\\n' | tail -n 20 >&2; exit 1; }}; }}; "
)

# Snakemake sets OMP_, OPENBLAS_ and MKL_NUM_THREADS to a job's threads, not this one.
os.environ.setdefault("NUMBA_NUM_THREADS", "1")


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

ENSEMBLES = range(
    1, max((study.sampling.ensembles for study in STUDIES.values()), default=0) + 1
)


def any_of(names):
    """A pattern that matches these names and nothing else."""
    return "|".join(re.escape(name) for name in sorted(names)) or "none"


wildcard_constraints:
    study=any_of(STUDIES),
    population=any_of(POPULATIONS),
    candidate=any_of({name for study in STUDIES.values() for name in study.candidates}),
    ensemble=r"\d+",


def modules(*patterns):
    """Source files behind a command; Snakemake does not notice edits in src/ by itself."""
    found = []
    for pattern in patterns:
        matches = sorted(str(path) for path in PACKAGE.glob(pattern))
        if not matches:
            sys.exit(f"workflow/rules: no module src/deabayes/{pattern}")
        found += matches
    return found


def settings_of(wildcards):
    """One study's settings: a parameter of its job, so that editing one reruns only that one."""
    settings = fit_settings(STUDIES[wildcards.study])
    return yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)


def settings_of_population(wildcards):
    """One population's settings, for the same reason."""
    settings = population_to_settings(POPULATIONS[wildcards.population])
    return yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)


def posteriors_of_members(wildcards):
    """The posteriors that a population puts together."""
    population = POPULATIONS[wildcards.population]
    return expand(
        "<results>/{study}/{candidate}/posterior.nc",
        study=population.studies,
        candidate=population.candidate,
    )


def prepared_of_members(wildcards):
    """The prepared records of a population's specimens."""
    studies = POPULATIONS[wildcards.population].studies
    return expand("<results>/{study}/prepared", study=studies)


def raw_files(wildcards):
    """The study's specimen, table and records, wherever the records are."""
    study = STUDIES[wildcards.study]
    try:
        folder = read_folder(study.specimen, study.data_root, check_records=False)
    except UserError as error:
        raise WorkflowError(str(error)) from None
    records = [folder.locate(row) or folder.path / row.record for row in folder.table]
    tables = [folder.path / name for name in ("specimen.yaml", "experiments.csv")]
    return [str(path) for path in dict.fromkeys([*tables, *records])]


def own_model(wildcards):
    """The file that defines the study's system, where that is the user's own."""
    model = STUDIES[wildcards.study].model
    return [] if model is None else [str(model)]


def own_models():
    """The files that define systems of the studies."""
    files = [study.model for study in STUDIES.values() if study.model is not None]
    return sorted({str(file) for file in files})


def inherited_posterior(wildcards):
    """The posterior named by `prior_from`."""
    source = STUDIES[wildcards.study].prior_from
    return [] if source is None else [source]


def pooling_threads(wildcards, input):
    """Half of the cores, one ensemble each: a pool does not sample all the time it runs."""
    most = len(input.ensembles)
    try:
        cores = workflow.cores
    except WorkflowError:  # of a remote executor, which may be told of none
        cores = None
    return max(1, min(cores // 2, most)) if cores else most


def ensembles_of(wildcards):
    """One file per ensemble of a candidate."""
    count = STUDIES[wildcards.study].sampling.ensembles
    return expand(
        "<results>/{study}/{candidate}/ensembles/{ensemble}.nc",
        study=wildcards.study,
        candidate=wildcards.candidate,
        ensemble=range(1, count + 1),
    )


def posteriors_of(wildcards):
    """The posteriors of all candidates of a study."""
    return per_candidate(wildcards.study, "posterior.nc")


def scores_of(wildcards):
    """The scores of all candidates of a study."""
    return per_candidate(wildcards.study, "scores.json")


def checks_of(wildcards):
    """Evidence by nested sampling of all candidates of a study that asks for it."""
    asked = STUDIES[wildcards.study].evidence_check == "nested"
    return per_candidate(wildcards.study, "nested.json") if asked else []


def further_experiments_of(wildcards):
    """The experiments a study asks for, as YAML on one line."""
    entries = STUDIES[wildcards.study].further_experiments
    return json.dumps({name: dict(settings) for name, settings in entries.items()})


def errors_of(wildcards):
    """The error tables of all candidates of a study."""
    return per_candidate(wildcards.study, "errors.csv")


def per_candidate(study, name):
    """One file of each candidate of a study."""
    return expand(
        "<results>/{study}/{candidate}/{name}",
        study=study,
        candidate=STUDIES[study].candidates,
        name=name,
    )


def study_folders(wildcards, input):
    """The results folders of the studies whose figures are drawn."""
    return [str(Path(figures).parent) for figures in input.figures]


def left_out_options():
    """The studies left out, as options of `deabayes report`."""
    return [word for line in LEFT_OUT for word in ("--left-out", line)]
