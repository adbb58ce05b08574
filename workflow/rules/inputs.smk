"""What the rules are given: named functions of inputs and parameters.

A parameter holds what a job is made of, as text: Snakemake runs the job again when it changes.
"""

import json
from functools import cache
from pathlib import Path

import yaml
from deabayes.faults import UserError
from deabayes.pipeline import jobs
from deabayes.population.settings import to_settings as population_to_settings
from deabayes.study import settings_on_file


@cache
def read_tables(name):
    """A study's folder, and its row of experiments.csv by prepared record."""
    study = STUDIES[name]
    try:
        folder = jobs.study_folder(study)
        return folder, jobs.prepared_rows(study, folder)
    except UserError as error:
        raise WorkflowError(str(error)) from None


def as_yaml(settings):
    """Settings as a job writes them to a file."""
    return yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)


def settings_of_study(wildcards):
    """One study's settings, so that an edit of another study runs nothing of this one."""
    return as_yaml(settings_on_file(STUDIES[wildcards.study]))


def settings_of_record(wildcards):
    """The settings that one prepared record depends on."""
    _, rows = read_tables(wildcards.study)
    return as_yaml(
        jobs.record_settings(STUDIES[wildcards.study], rows[wildcards.record])
    )


def settings_of_candidate(wildcards):
    """The settings that the fit of one candidate depends on."""
    study, (folder, rows) = STUDIES[wildcards.study], read_tables(wildcards.study)
    return as_yaml(jobs.candidate_settings(study, wildcards.candidate, folder, rows))


def settings_of_population(wildcards):
    """One population's settings."""
    return as_yaml(population_to_settings(POPULATIONS[wildcards.population]))


def content_of_folder(wildcards):
    """Checksums of the tables and records that a study is checked with."""
    return jobs.folder_content(read_tables(wildcards.study)[0])


def content_of_record(wildcards):
    """The row, the specimen and the checksum of the file that one record is prepared from."""
    folder, rows = read_tables(wildcards.study)
    return jobs.record_content(folder, rows[wildcards.record])


def content_of_specimen(wildcards):
    """The specimen of a study."""
    return jobs.specimen_content(read_tables(wildcards.study)[0])


def prepared_of(wildcards):
    """All prepared records of a study."""
    return prepared_files(wildcards.study, read_tables(wildcards.study)[1])


def prepared_to_fit(wildcards):
    """The prepared records of a study that are calibrated on."""
    rows = read_tables(wildcards.study)[1].items()
    return prepared_files(
        wildcards.study, [name for name, row in rows if row.role == "calibrate"]
    )


def prepared_of_members(wildcards):
    """All prepared records of a population's specimens."""
    studies = POPULATIONS[wildcards.population].studies
    return [
        file for name in studies for file in prepared_files(name, read_tables(name)[1])
    ]


def prepared_files(study, records):
    """The files of some prepared records of a study."""
    return expand("<results>/{study}/prepared/{record}.nc", study=study, record=records)


def prepared_folder(wildcards, input):
    """The folder of a study's prepared records."""
    return str(Path(input.records[0]).parent)


def own_model(wildcards):
    """The file that defines the study's system, where that is the user's own."""
    model = STUDIES[wildcards.study].model
    return [] if model is None else [str(model)]


def inherited_posterior(wildcards):
    """The posterior named by `prior_from`."""
    source = STUDIES[wildcards.study].prior_from
    return [] if source is None else [source]


def posteriors_of_members(wildcards):
    """The posteriors that a population puts together."""
    population = POPULATIONS[wildcards.population]
    return expand(
        "<results>/{study}/{candidate}/posterior.nc",
        study=population.studies,
        candidate=population.candidate,
    )


def of_candidates(name):
    """Input function: this file of each candidate of a study."""

    def files(wildcards):
        return expand(
            "<results>/{study}/{candidate}/{name}",
            study=wildcards.study,
            candidate=STUDIES[wildcards.study].candidates,
            name=name,
        )

    return files


def checks_of(wildcards):
    """Evidence by nested sampling of all candidates of a study that asks for it."""
    asked = STUDIES[wildcards.study].evidence_check == "nested"
    return of_candidates("nested.json")(wildcards) if asked else []


def further_experiments_of(wildcards):
    """The experiments a study asks for, as YAML on one line."""
    entries = STUDIES[wildcards.study].further_experiments
    return json.dumps({name: dict(settings) for name, settings in entries.items()})


def study_folders(wildcards, input):
    """The results folders of the studies whose figures are drawn."""
    return [str(Path(figures).parent) for figures in input.figures]


def left_out_options():
    """The studies left out, as options of `deabayes report`."""
    return [word for line in LEFT_OUT for word in ("--left-out", line)]
