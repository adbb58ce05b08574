"""Checks of a study against its folder before anything is run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deabayes.checks.prepared import prepared_records, unmodelled
from deabayes.checks.priors import check_priors, unexpected
from deabayes.comparison import further as planned
from deabayes.faults import Faults, MissingQuantity, UserError, nearest
from deabayes.own_models.checks import candidate_faults
from deabayes.own_models.loading import said_of_the_model
from deabayes.own_models.trial import try_models
from deabayes.records.checks import too_few_points, too_short_for
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import StudyFolder, read_folder, repeated_records, scan_folder
from deabayes.records.preparation.defaults import misaddressed
from deabayes.records.preparation.working import noting_bare_numbers
from deabayes.records.table import in_roles, none_to_fit, selected, told_apart_by
from deabayes.systems import system_class

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, Experiment, Specimen
    from deabayes.study import Study
    from deabayes.systems import System


def few_points(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment]
) -> list[str]:
    """Faults: candidates with at least as many parameters as there are prepared points to fit."""
    fitted = [each.response.size for each in experiments if each.role == "calibrate"]
    if not fitted:  # another check reports this
        return []
    return [
        fault
        for candidate, system in systems.items()
        for fault in too_few_points(
            sum(fitted), len(system.parameters()), f"study {study.name}, {candidate}"
        )
    ]


def unused_steps(
    study: Study, protocols: Iterable[str], known: Iterable[str]
) -> tuple[list[str], list[str]]:
    """Return faults and warnings: preparation of protocols that no record of the study has.

    Parameters
    ----------
    protocols : protocols of the study's records.
    known : protocols that the specimen's system has a model of; others are a fault.
    """
    protocols, known = list(protocols), list(known)
    faults = [
        f"study {study.name}, preparation: the specimen's system has no model of protocol {name!r} "
        f"(it has {', '.join(known)}); correct or remove it"
        for name in study.preparation
        if name not in known
    ]
    warnings = [
        f"study {study.name}, preparation.{name}: no record of the study is of this protocol, so "
        "these steps do nothing"
        for name in study.preparation
        if name in known and name not in protocols
    ]
    return faults, warnings


def built_candidates(study: Study, specimen: Specimen, faults: list[str]) -> dict[str, System]:
    """Return the candidates that can be built, and add the faults of others to `faults`.

    Faults of the models of `predict_with` are added as well.
    """
    systems, found = {}, []
    for candidate in study.candidates:
        key = "candidates"
        try:
            systems[candidate] = _built(study, candidate, specimen)
            key = "predict_with"
            for ending in study.predict_with.values():
                _built(study, candidate + ending, specimen)
        except UserError as error:
            found += [f"study {study.name}, {key}: {each}" for each in str(error).splitlines()]
    faults += dict.fromkeys(found)
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


SAMPLES = 50
"""Number of samples of a record with which to ask whether a candidate can predict it."""


def without_candidate(read: StudyFolder) -> list[str]:
    """Faults: records that no candidate can predict, for lack of a quantity or a condition.

    Each fault is reported once, for the first record that has it. For a record with faults only
    missing quantities are reported. Nothing is reported if specimen.yaml has faults. A user's
    own systems have their own checks.
    """
    from deabayes.systems import OWN, REGISTRY

    system = read.specimen.system
    if system in OWN or system not in REGISTRY or not read.file.sound:
        return []
    found: dict[str, str] = {}
    for row in read.table:
        try:
            reasons = _reasons(read.specimen, row, _driven(read, row))
        except UserError:  # other checks report this
            reasons = _reasons(read.specimen, row, _stand_in(row, system))
            reasons = [each for each in reasons if isinstance(each, MissingQuantity)]
        for reason in map(str, reasons):
            found.setdefault(reason, f"{read.path / 'experiments.csv'} ({row.name}): {reason}")
    return list(found.values())


def _driven(read: StudyFolder, row: ExperimentRow) -> Excitation:
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


def _stand_in(row: ExperimentRow, system: str) -> Excitation:
    """Return a plausible excitation for a record with faults, to find the quantities it needs."""
    from deabayes.experiment import Excitation
    from deabayes.records.columns import COMMANDS
    from deabayes.records.record_checks import POSITIVE
    from deabayes.records.table import WITHOUT_TIME, channels_of

    unit = channels_of(system, row.protocol)[0][row.excitation]
    time = np.linspace(0.0, 1.0, SAMPLES)
    values = 1.0 + 0.1 * time if row.excitation in POSITIVE else 1e-3 * time
    in_time = row.protocol not in WITHOUT_TIME
    name = COMMANDS.get(row.excitation, row.excitation)
    held = {**row.metadata, "voltage": 0.0}
    return Excitation(name, unit, time if in_time else values, values, held, in_time)


def _reasons(specimen: Specimen, row: ExperimentRow, driven: Excitation) -> Sequence[UserError]:
    """Return the reasons why no candidate predicts a record; empty if one may.

    These are all missing quantities of the first candidate that lacks any, else the faults of
    the first candidate. A candidate that is not meant for this response does not count, because
    only examples are tried.
    """
    from deabayes.systems import candidates

    each = [_obstacles(specimen, name, row, driven) for name in candidates(specimen.system)]
    if [] in each:
        return []
    general = [found for found in each if not str(found[-1]).startswith("candidate ")]
    lacking = [[e for e in found if isinstance(e, MissingQuantity)] for found in general]
    return next(filter(None, lacking), next(iter(general), []))


def _obstacles(
    specimen: Specimen, candidate: str, row: ExperimentRow, driven: Excitation
) -> Sequence[UserError]:
    """Return every quantity that a candidate lacks, and any other fault of its prediction."""
    from deabayes.experiment import Quantity
    from deabayes.systems import build

    found: list[UserError] = []
    while True:
        try:
            build(specimen.system, candidate, specimen).simulator(
                driven, driven.coordinate, row.response
            )
        except MissingQuantity as lacking:
            found.append(lacking)
            stand_in = {lacking.quantity: Quantity(1.0, lacking.unit)}
            specimen = replace(specimen, quantities={**specimen.quantities, **stand_in})
        except UserError as error:
            return [*found, error]
        else:
            return found


def check_study(study: Study, compare: bool = False) -> tuple[list[str], list[str]]:
    """Return faults and warnings of a study, given its folder's records.

    Candidates, experiment names, noise model, preparation steps and parameters with a prior must
    exist and have usable settings. There must be more points to calibrate on than parameters.
    Records should be longer than the longest time constant of the prior. With `compare` the
    first candidate's prior is compared with the records; its model may have to be compiled.
    """
    read, faults = scan_folder(study.specimen, study.data_root)
    faults += _unknown_names(study)
    if read is None or faults:
        return faults + ([] if read is None else without_candidate(read)), []
    faults += [f"study {study.name}, {x}" for x in misaddressed(study.preparation, read.table)]
    rows = used_rows(study, read, faults)
    faults += _further_faults(study, rows)
    if study.calibrate is not None or study.validate is not None:
        every = ((row, read.record(row)) for row in rows)
        faults += repeated_records(every, f"study {study.name}")
    used = [(row, read.record(row)) for row in rows]
    faults += unmodelled(system_class(read.specimen.system), used, study.name)
    records = [(row, raw) for row, raw in used if row.role == "calibrate"]
    warnings: list[str] = []
    systems = built_candidates(study, read.specimen, faults)
    unused = unused_steps(
        study, [row.protocol for row in rows], system_class(read.specimen.system).protocols
    )
    faults, warnings = [*faults, *unused[0]], [*warnings, *unused[1]]
    with noting_bare_numbers() as bare_numbers:
        experiments, unprepared, said = prepared_records(study, read, rows)
    warnings += [*(f"study {study.name}, {line}" for line in bare_numbers), *said]
    faults += unprepared or few_points(study, systems, experiments)
    if not faults:
        faults += _without_model(study, systems, experiments)
        each = [caution for s in systems.values() for e in experiments for caution in s.cautions(e)]
        warnings += dict.fromkeys(each)
    if not faults:
        wrong, bare = check_priors(study, systems, experiments)
        faults, warnings = [*faults, *wrong], [*warnings, *bare]
    if not faults and study.model is not None:
        fitted = [each for each in experiments if each.role == "calibrate"]
        found = try_models(systems, fitted, study.priors, f"study {study.name}")
        faults, warnings = found[0], [*warnings, *found[1]]
    if not faults:
        warnings += [line for s in systems.values() for line in _too_short(study, s, records)]
    if compare and not faults:
        candidate, system = next(iter(systems.items()))
        lines = unexpected(study, system, experiments)
        warnings += [f"study {study.name}, {candidate}, {line}" for line in lines]
    return faults, warnings


def check_names(study: Study) -> list[str]:
    """Return the faults that can be found without reading a record.

    These concern the folder's tables, the names in them, and files. A workflow reports them for
    all studies before its first job.
    """
    try:
        read = read_folder(study.specimen, study.data_root, check_records=False)
    except UserError as error:
        return [*str(error).splitlines(), *_unknown_names(study)]
    faults = [*read.missing(read.table), *_unknown_names(study)]
    faults += [f"study {study.name}, {x}" for x in misaddressed(study.preparation, read.table)]
    faults += _further_faults(study, used_rows(study, read, faults))
    built_candidates(study, read.specimen, faults)
    return faults


def _without_model(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment]
) -> list[str]:
    """Faults: records that a candidate cannot model; each message appears once."""
    from deabayes.inference.default_priors import wider_systems

    found: dict[str, str] = {}
    for candidate, system in systems.items():
        wider = wider_systems(study, system)
        for each in experiments:
            held_out = each.role == "validate"
            predicts = wider.get(each.protocol, system) if held_out else system
            try:
                predicts.simulator_of(each)
            except UserError as error:
                where = f"study {study.name}, {candidate}, {each.name}"
                found.setdefault(str(error), f"{where}: {error}")
    return list(found.values())


def _unknown_names(study: Study) -> list[str]:
    from deabayes.noise import REGISTRY as NOISE
    from deabayes.records.preparation import REGISTRY as STEPS

    faults = []
    if study.noise not in NOISE:
        faults.append(f"study {study.name}, noise: unknown {study.noise!r}"
                      f"{nearest(study.noise, NOISE)}")  # fmt: skip
    for protocol, steps in study.preparation.items():
        for step in steps or ():
            name = step if isinstance(step, str) else next(iter(step))
            if name not in STEPS:
                faults.append(f"study {study.name}, preparation.{protocol}: unknown step {name!r}"
                              f"{nearest(name, STEPS)}")  # fmt: skip
    return faults


def used_rows(study: Study, read: StudyFolder, faults: list[str]) -> list[ExperimentRow]:
    """Return the rows that a study uses, in their roles in the study."""
    kept = selected(read.table, study.select)
    if not kept:
        faults += _nothing_selected(study, read)
        return []
    known = [row.name for row in kept]
    unknown = [
        f"study {study.name}, {role}: {study.specimen} has no experiment {name!r}"
        f"{nearest(name, known)}"
        for role, names in (("calibrate", study.calibrate), ("validate", study.validate))
        for name in names or ()
        if name not in known
    ]
    faults += unknown
    used = in_roles(kept, study.calibrate, study.validate)
    if not unknown and not any(row.role == "calibrate" for row in used):
        said = none_to_fit(study.specimen, study.calibrate, study.validate)
        faults.append(f"study {study.name}: {said}")
    return used


def _nothing_selected(study: Study, read: StudyFolder) -> list[str]:
    """Say why no row has the values of `select`, column by column."""
    table = [told_apart_by(row) for row in read.table]
    columns = dict.fromkeys(key for values in table for key in values)
    found = []
    for key, value in study.select.items():
        where = f"study {study.name}, select: {study.specimen}"
        values = [str(each[key]) for each in table if key in each]
        if key not in columns:
            found.append(f"{where} has no column {key!r} in experiments.csv{nearest(key, columns)}")
        elif not selected(read.table, {key: value}):
            hint = nearest(value, dict.fromkeys(values))
            found.append(f"{where} has no experiment with {key} {value!r}{hint}")
    return found or [f"{where} has no experiment with all of these values; drop one of them"]


def _further_faults(study: Study, rows: Sequence[ExperimentRow]) -> list[str]:
    """Faults of planned experiments: unknown records, or plans that are impossible for a record."""
    found = planned.faults(study.further_experiments, {row.name: row.protocol for row in rows})
    return [f"study {study.name}, further_experiments: {fault}" for fault in found]


def _too_short(
    study: Study, system: System, records: Sequence[tuple[ExperimentRow, RawRecord]]
) -> list[str]:
    """Warn of stated time-constant priors beyond the records; default priors follow the records."""
    from deabayes.prior.joint import Prior
    from deabayes.systems import OWN

    prior = Prior.from_parameters(system.parameters(), study.priors, study.priors)
    durations = [float(np.ptp(raw.columns["time"])) for _, raw in records if "time" in raw.columns]
    where = f"study {study.name}, {system.candidate}, the longest record"
    own = type(system) in OWN.values()
    written = [p for p in prior.parameters if own or p.source == "config"]
    return too_short_for(written, durations, where)
