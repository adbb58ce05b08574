"""Checks of a study against its folder before anything is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deabayes.checks.prepared import prepared_records, unmodelled
from deabayes.checks.priors import check_priors, unexpected
from deabayes.comparison import further as planned
from deabayes.faults import Faults, MissingQuantity, Report, UserError, nearest
from deabayes.own_models.checks import candidate_faults
from deabayes.own_models.loading import said_of_the_model
from deabayes.own_models.trial import try_models
from deabayes.quantities import with_unit
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import StudyFolder, read_folder, repeated_records, scan_folder
from deabayes.records.preparation.defaults import misaddressed
from deabayes.records.table import in_roles, none_to_fit, selected, told_apart_by
from deabayes.systems import system_class

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, Experiment, Specimen
    from deabayes.prior.distributions import Distribution
    from deabayes.study import Study
    from deabayes.systems import System

SAMPLES = 50
"""Number of samples of a record with which to ask whether a candidate can predict it."""
LOWER_END, UPPER_QUARTILE = -1.645, 0.6745
"""The 5 % quantile and the upper quartile of a prior, in its normal coordinate."""


def check_study(study: Study, compare: bool = False, read: StudyFolder | None = None) -> Report:
    """Report faults and warnings of a study, given its folder's records.

    Candidates, experiment names, noise model, preparation steps and parameters with a prior must
    exist and have usable settings. There must be more points to calibrate on than parameters.
    Records should be longer than the longest time constant of the prior.

    Parameters
    ----------
    compare : whether to compare the first candidate's prior with the records; its model may have
        to be compiled.
    read : the study's folder with checked records; None reads it here.
    """
    report = Report()
    if read is None:
        read = scan_folder(study.specimen, report, study.data_root)
    else:
        report.include(read.faults)
    of_study = report.at(f"study {study.name}")
    _check_names_of_methods(study, of_study)
    if read is not None and report.faults:
        without_candidate(read, report)
    elif read is not None:
        check_on_records(study, read, of_study, compare)
    return report


def check_on_records(study: Study, read: StudyFolder, report: Report, compare: bool) -> None:
    """Report faults and warnings of a study of a folder whose records have no faults."""
    system = system_class(read.specimen.system)
    report.include(misaddressed(study.preparation, read.table))
    rows = used_rows(study, read, report)
    _check_planned(study, rows, report)
    records = [(row, read.record(row)) for row in rows]
    if study.calibrate is not None or study.validate is not None:
        repeated_records(records, report)
    unmodelled(system, records, report)
    systems = built_candidates(study, read.specimen, report)
    _check_unused_steps(study, rows, system, report)
    faults_before = len(report.faults)
    experiments = prepared_records(study, read, rows, report)
    if len(report.faults) == faults_before:
        _check_number_of_points(systems, experiments, report)
    if not report.faults:
        _check_models(study, systems, experiments, report)
    if not report.faults:
        check_priors(study, systems, experiments, report)
    if not report.faults and study.model is not None:
        fitted = [experiment for experiment in experiments if experiment.role == "calibrate"]
        faults, warnings = try_models(systems, fitted, study.priors, report.place)
        report.faults += faults
        report.warnings += warnings
    if not report.faults:
        for candidate in systems.values():
            _check_times(study, candidate, records, experiments, report)
    if not report.faults and compare:
        name, candidate = next(iter(systems.items()))
        report.at(name).include(warnings=unexpected(study, candidate, experiments))


def check_names(study: Study) -> list[str]:
    """Return the faults that can be found without reading a record.

    These concern the folder's tables, the names in them, and files. A workflow reports them for
    all studies before its first job.
    """
    report = Report()
    of_study = report.at(f"study {study.name}")
    read = None
    with report.catching():
        read = read_folder(study.specimen, study.data_root, check_records=False)
        report.include(read.missing(read.table))
    _check_names_of_methods(study, of_study)
    if read is not None:
        of_study.include(misaddressed(study.preparation, read.table))
        _check_planned(study, used_rows(study, read, of_study), of_study)
        built_candidates(study, read.specimen, of_study)
    return report.faults


def _check_names_of_methods(study: Study, report: Report) -> None:
    """Report a noise model and preparation steps that do not exist."""
    from deabayes.noise import REGISTRY as NOISE
    from deabayes.records.preparation import REGISTRY as STEPS

    if study.noise not in NOISE:
        report.fault(f"unknown {study.noise!r}{nearest(study.noise, NOISE)}", "noise")
    for protocol, steps in study.preparation.items():
        for step in steps or ():
            name = step if isinstance(step, str) else next(iter(step))
            if name not in STEPS:
                hint = nearest(name, STEPS)
                report.fault(f"unknown step {name!r}{hint}", f"preparation.{protocol}")


def used_rows(study: Study, read: StudyFolder, report: Report) -> list[ExperimentRow]:
    """Return the rows that a study uses, in their roles in the study."""
    kept = selected(read.table, study.select)
    if not kept:
        _nothing_selected(study, read, report)
        return []
    known = [row.name for row in kept]
    all_known = True
    for role, names in (("calibrate", study.calibrate), ("validate", study.validate)):
        for name in names or ():
            if name not in known:
                all_known = False
                hint = nearest(name, known)
                report.fault(f"{study.specimen} has no experiment {name!r}{hint}", role)
    used = in_roles(kept, study.calibrate, study.validate)
    if all_known and not any(row.role == "calibrate" for row in used):
        report.fault(none_to_fit(study.specimen, study.calibrate, study.validate))
    return used


def _nothing_selected(study: Study, read: StudyFolder, report: Report) -> None:
    """Say why no row has the values of `select`, column by column."""
    table = [told_apart_by(row) for row in read.table]
    columns = dict.fromkeys(key for values in table for key in values)
    reasons = []
    for key, value in study.select.items():
        if key not in columns:
            reasons.append(f"no column {key!r} in experiments.csv{nearest(key, columns)}")
        elif not selected(read.table, {key: value}):
            values = dict.fromkeys(str(row[key]) for row in table if key in row)
            reasons.append(f"no experiment with {key} {value!r}{nearest(value, values)}")
    for reason in reasons or ["no experiment with all of these values; drop one of them"]:
        report.fault(f"{study.specimen} has {reason}", "select")


def _check_planned(study: Study, rows: Sequence[ExperimentRow], report: Report) -> None:
    """Report planned experiments that are unknown, or impossible for a record."""
    protocols = {row.name: row.protocol for row in rows}
    for fault in planned.faults(study.further_experiments, protocols):
        report.fault(fault, "further_experiments")


def _check_unused_steps(
    study: Study, rows: Sequence[ExperimentRow], system: type[System], report: Report
) -> None:
    """Report steps for a protocol that no record has: a fault if the system does not know it."""
    protocols = {row.protocol for row in rows}
    for name in study.preparation:
        if name not in system.protocols:
            report.fault(
                f"the specimen's system has no model of protocol {name!r} (it has "
                f"{', '.join(system.protocols)}); correct or remove it",
                "preparation",
            )
        elif name not in protocols:
            report.warn(
                "no record of the study is of this protocol, so these steps do nothing",
                f"preparation.{name}",
            )


def built_candidates(study: Study, specimen: Specimen, report: Report) -> dict[str, System]:
    """Return the candidates that can be built, and report the faults of others.

    Faults of the models of `predict_with` are reported as well.
    """
    systems = {}
    for candidate in study.candidates:
        key = "candidates"
        try:
            systems[candidate] = _built(study, candidate, specimen)
            key = "predict_with"
            for ending in study.predict_with.values():
                _built(study, candidate + ending, specimen)
        except UserError as error:
            for fault in str(error).splitlines():
                report.fault(fault, key)
    return systems


def _built(study: Study, candidate: str, specimen: Specimen) -> System:
    """Build a candidate, and check it if it belongs to a user's own system."""
    from deabayes.systems import build

    if study.model is None:
        return build(specimen.system, candidate, specimen)
    with said_of_the_model():
        system = build(specimen.system, candidate, specimen)
        faults = candidate_faults(system, candidate)
    if faults:
        raise Faults(f"{study.model}: {fault}" for fault in faults)
    return system


def _check_number_of_points(
    systems: Mapping[str, System], experiments: Sequence[Experiment], report: Report
) -> None:
    """Report candidates with at least as many parameters as there are points to calibrate on."""
    points = sum(e.response.size for e in experiments if e.role == "calibrate")
    for candidate, system in systems.items():
        parameters = len(system.parameters())
        if 0 < points <= parameters:  # another check reports that there are none
            report.fault(
                f"{points} points cannot determine {parameters} parameters; give more data or a "
                "smaller candidate",
                candidate,
            )


def _check_models(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment], report: Report
) -> None:
    """Report records that a candidate cannot model, each reason once, and cautions of models."""
    from deabayes.inference.default_priors import wider_systems

    reasons: set[str] = set()
    for candidate, system in systems.items():
        wider = wider_systems(study, system)
        for experiment in experiments:
            held_out = experiment.role == "validate"
            predicts = wider.get(experiment.protocol, system) if held_out else system
            try:
                predicts.simulator_of(experiment)
            except UserError as error:
                if str(error) not in reasons:
                    report.fault(str(error), f"{candidate}, {experiment.name}")
                reasons.add(str(error))
    if not reasons:
        for system in systems.values():
            for experiment in experiments:
                cautions = [w for w in system.cautions(experiment) if w not in report.warnings]
                report.warnings += cautions


def _check_times(
    study: Study,
    system: System,
    records: Sequence[tuple[ExperimentRow, RawRecord]],
    experiments: Sequence[Experiment],
    report: Report,
) -> None:
    """Warn of time constants that a prior states and no record can show.

    These are constants longer than all records, or shorter than the records resolve. Default
    priors follow the records and are not compared.
    """
    from deabayes.inference.default_priors import resolved_time

    durations = [
        float(np.ptp(raw.columns["time"]))
        for row, raw in records
        if row.role == "calibrate" and "time" in raw.columns
    ]
    stated = _stated_times(study, system)
    if not durations or not stated:
        return
    longest = max(float(each.from_normal(np.array(UPPER_QUARTILE))) for each in stated)
    if max(durations) < longest:
        report.warn(
            f"lasts {max(durations):.3g} s, less than the longest time constant of the prior "
            f"({longest:.3g} s), which the prior will then set",
            f"{system.candidate}, the longest record",
        )
    timed = [e for e in experiments if e.role == "calibrate" and e.coordinate_name == "time"]
    shown = system.time_scale * min((resolved_time(each) for each in timed), default=0.0)
    shortest = min(float(each.from_normal(np.array(LOWER_END))) for each in stated)
    if shortest < shown:
        begins, least = (with_unit(time, "s", digits=3) for time in (shortest, shown))
        report.warn(
            f"has time constants from {begins} on, but the records show none below {least}. A "
            "faster unit looks like a spring, or like no unit, and its modulus is not determined. "
            f"Begin the prior at {least}",
            f"{system.candidate}, prior",
        )


def _stated_times(study: Study, system: System) -> list[Distribution]:
    """Priors of time constants that a study, or a user's own system, states."""
    from deabayes.prior.joint import Prior
    from deabayes.systems import OWN

    prior = Prior.from_parameters(system.parameters(), study.priors, study.priors)
    own = type(system) in OWN.values()
    return [
        parameter.prior
        for parameter in prior.parameters
        if parameter.is_time_constant and (own or parameter.source == "config")
    ]


def without_candidate(read: StudyFolder, report: Report) -> None:
    """Report records that no candidate can predict, for lack of a quantity or a condition.

    Each fault is reported once, for the first record that has it. For a record with faults only
    missing quantities are reported. Nothing is reported if specimen.yaml has faults. A user's
    own systems have their own checks.
    """
    from deabayes.systems import OWN, REGISTRY

    system = read.specimen.system
    if system in OWN or system not in REGISTRY or not read.file.sound:
        return
    faults: dict[str, str] = {}
    for row in read.table:
        try:
            reasons = _reasons(read.specimen, row, _beginning_of_excitation(read, row))
        except UserError:  # other checks report this
            reasons = _reasons(read.specimen, row, _excitation_like(row, system))
            reasons = [reason for reason in reasons if isinstance(reason, MissingQuantity)]
        for reason in map(str, reasons):
            faults.setdefault(reason, f"{read.path / 'experiments.csv'} ({row.name}): {reason}")
    report.include(faults.values())


def _beginning_of_excitation(read: StudyFolder, row: ExperimentRow) -> Excitation:
    """Return the beginning of a record's excitation."""
    from deabayes.experiment import Excitation
    from deabayes.records.preparation.working import conditions, open_record

    raw = read.record(row)
    record = open_record(row, raw, read.specimen)
    return Excitation(
        record.row.excitation,
        record.excitation_unit,
        record.excitation_coordinate[:SAMPLES],
        record.excitation[:SAMPLES],
        conditions(record.row, raw),
        record.in_time,
    )


def _excitation_like(row: ExperimentRow, system: str) -> Excitation:
    """Return a plausible excitation for a record with faults, to find the quantities it needs."""
    from deabayes.experiment import Excitation
    from deabayes.records.checks import POSITIVE
    from deabayes.records.columns import COMMANDS
    from deabayes.records.table import WITHOUT_TIME, channels_of

    unit = channels_of(system, row.protocol)[0][row.excitation]
    time = np.linspace(0.0, 1.0, SAMPLES)
    values = 1.0 + 0.1 * time if row.excitation in POSITIVE else 1e-3 * time
    in_time = row.protocol not in WITHOUT_TIME
    name = COMMANDS.get(row.excitation, row.excitation)
    conditions = {**row.metadata, "voltage": 0.0}
    return Excitation(name, unit, time if in_time else values, values, conditions, in_time)


def _reasons(specimen: Specimen, row: ExperimentRow, excitation: Excitation) -> Sequence[UserError]:
    """Return the reasons why no candidate predicts a record; empty if one may.

    These are all missing quantities of the first candidate that lacks any, else the faults of
    the first candidate. A candidate that is not meant for this response does not count, because
    only examples are tried.
    """
    from deabayes.systems import candidates

    tried = [_obstacles(specimen, name, row, excitation) for name in candidates(specimen.system)]
    if [] in tried:
        return []
    general = [errors for errors in tried if not str(errors[-1]).startswith("candidate ")]
    lacking = [[e for e in errors if isinstance(e, MissingQuantity)] for errors in general]
    return next(filter(None, lacking), next(iter(general), []))


def _obstacles(
    specimen: Specimen, candidate: str, row: ExperimentRow, excitation: Excitation
) -> Sequence[UserError]:
    """Return every quantity that a candidate lacks, and any other fault of its prediction."""
    from deabayes.experiment import Quantity
    from deabayes.systems import build

    errors: list[UserError] = []
    while True:
        try:
            build(specimen.system, candidate, specimen).simulator(
                excitation, excitation.coordinate, row.response
            )
        except MissingQuantity as lacking:
            errors.append(lacking)
            stand_in = {lacking.quantity: Quantity(1.0, lacking.unit)}
            specimen = replace(specimen, quantities={**specimen.quantities, **stand_in})
        except UserError as error:
            return [*errors, error]
        else:
            return errors
