"""What the rules are given: named functions of inputs and parameters."""

import json
from pathlib import Path

import yaml
from deabayes.faults import UserError
from deabayes.pipeline import fit_made_of, sums
from deabayes.population.settings import to_settings as population_to_settings
from deabayes.records.folder import read_folder
from deabayes.study import settings_on_file


def settings_of(wildcards):
    """One study's settings: a parameter of its job, so that editing one reruns only that one."""
    settings = settings_on_file(STUDIES[wildcards.study])
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


def raw_sums(wildcards):
    """What the raw files hold: a record may be replaced by an older file."""
    return json.dumps(sums(Path(path) for path in raw_files(wildcards)))


def made_of(wildcards):
    """What a fit of the study is made of, its code aside, as a sum."""
    try:
        return fit_made_of(STUDIES[wildcards.study])
    except UserError as error:
        raise WorkflowError(str(error)) from None


def own_model(wildcards):
    """The file that defines the study's system, where that is the user's own."""
    model = STUDIES[wildcards.study].model
    return [] if model is None else [str(model)]


def inherited_posterior(wildcards):
    """The posterior named by `prior_from`."""
    source = STUDIES[wildcards.study].prior_from
    return [] if source is None else [source]


def posterior_from_outside(wildcards):
    """The same, if it is none of this workflow's."""
    results = Path(workflow.pathvars.items["results"])
    found = inherited_posterior(wildcards)
    return [path for path in found if not Path(path).is_relative_to(results)]


def until_there(needed, *made):
    """An input that is waited for, and that makes no job run again whose outputs are up to date.

    `ancient` alone would also leave out an output that is missing or older than what it is made
    of, in a run that makes the input again: Snakemake looks at nothing else of the jobs after it.
    """

    def found(wildcards):
        names = (needed, CODE, *made)
        paths = (workflow.pathvars.apply(name) for name in names)
        path, code, *outputs = expand(list(paths), **dict(wildcards.items()))
        oldest = min(changed(output) for output in outputs)
        return ancient(path) if oldest > changed(code) else path

    return found


def changed(path):
    """When a file was changed, in seconds; 0 if it is not there."""
    return Path(path).stat().st_mtime if Path(path).exists() else 0


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
