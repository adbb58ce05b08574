"""Preparation of a record before inference, as a sequence of named steps.

The raw file is never changed. A step is a function of a record and of its settings in
config.yaml. Each step has its own file and one line in `REGISTRY`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.faults import Report, UserError, nearest
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation.average import average
from deabayes.records.preparation.cycles import cycles
from deabayes.records.preparation.defaults import DEFAULT_STEPS, default_steps
from deabayes.records.preparation.excitation import (
    excitation_knots,
    excitation_spline,
    limit_current,
    slack_end,
    take_up_slack,
    warn_of_slack,
)
from deabayes.records.preparation.masks import (
    crop,
    decimate,
    mask_after,
    mask_before,
    mask_between,
    mask_ramp_end,
    mask_slack,
)
from deabayes.records.preparation.response import (
    baseline,
    delay,
    reading_at_rest,
    scale,
    warn_if_apart,
    warn_of_drift,
)
from deabayes.records.preparation.working import WorkingRecord, conditions, open_record
from deabayes.records.table import measured_rows

__all__ = ["DEFAULT_STEPS", "REGISTRY", "measured_rows", "prepare"]
Step = Callable[[WorkingRecord, Mapping[str, object]], WorkingRecord]

REGISTRY: Mapping[str, Step] = {
    step.__name__: step
    for step in (
        average,
        baseline,
        crop,
        cycles,
        decimate,
        delay,
        excitation_knots,
        excitation_spline,
        limit_current,
        mask_after,
        mask_before,
        mask_between,
        mask_ramp_end,
        mask_slack,
        scale,
        take_up_slack,
    )
}
"""Step name -> function of the same name."""
NEEDS_TIME = (
    "baseline",
    "cycles",
    "delay",
    "excitation_knots",
    "excitation_spline",
    "limit_current",
    "mask_ramp_end",
    "mask_slack",
)
ONCE = ("delay",)
"""Steps allowed once per record, because repeating them adds up. Other steps may be repeated."""
FEWEST_POINTS = 4


def prepare(
    row: ExperimentRow,
    raw: RawRecord,
    specimen: Specimen,
    steps: Sequence[Mapping[str, object] | str] | None = None,
    bare_numbers: Report | None = None,
) -> Experiment:
    """Prepare one raw record for inference.

    Parameters
    ----------
    row : the record's row of experiments.csv.
    raw : the record's columns in SI, checked (`StudyFolder.record`).
    specimen : what was tested; `instruments.delay` is used by the step `delay`.
    steps : ordered single-key mappings {step: settings}; a bare name is a step
        without settings; None takes the default steps (`defaults`).
    bare_numbers : takes a warning on each setting without a unit, which is read as SI.

    Raises
    ------
    UserError : unknown step or setting, wrong unit, no samples left.
    """
    record = open_record(row, raw, specimen, bare_numbers)
    slack, rest = slack_end(record), reading_at_rest(record)
    if rest is not None and (not rest.is_offset or (slack is not None and not rest.seen)):
        rest = None
    entries = default_steps(record, rest is not None and rest.seen) if steps is None else steps
    settings_of = [_parsed(entry, record) for entry in entries]
    names = {name for name, _ in settings_of}
    if rest is not None and (steps is None or "baseline" not in names):
        record.report.warn(rest.sentence("baseline" in names))
    warn_of_drift(record)
    if slack is not None and "take_up_slack" not in names:
        warn_of_slack(record, slack)
    if "delay" not in names:
        warn_if_apart(record)
    for name, settings in settings_of:
        record = _apply(name, settings, record)
    return _experiment(record, raw)


def _apply(name: str, settings: Mapping[str, object], record: WorkingRecord) -> WorkingRecord:
    """Apply one step and add it to the record's history."""
    if name not in REGISTRY:
        raise UserError(
            f"preparation of {record.row.protocol}: unknown step {name!r}{nearest(name, REGISTRY)}"
        )
    delayed = name == "delay" and record.coordinate_name == "frequency"
    if name in NEEDS_TIME and not record.in_time and not delayed:
        raise UserError(
            f"preparation of {record.row.name}: step {name!r} needs a record in time, and "
            f"a {record.row.protocol} record has none; remove the step"
        )
    if name in ONCE and any(done["step"] == name for done in record.steps):
        raise UserError(
            f"preparation of {record.row.name}: step {name!r} is there twice and would move the "
            "response twice; keep one (of two delays, with their sum for its `time`)"
        )
    after = REGISTRY[name](record, settings)
    if not after.used.any():
        left = record.coordinate[record.used]
        raise UserError(
            f"preparation of {record.row.name}: step {name!r} leaves no sample of those from "
            f"{left.min():.6g} to {left.max():.6g} {record.coordinate_unit}; change its settings, "
            f"or the unit of the record's {record.coordinate_name}"
        )
    return after.with_step(name, settings, record)


def _parsed(
    entry: Mapping[str, object] | str, record: WorkingRecord
) -> tuple[str, Mapping[str, object]]:
    """Return a step's name and settings from one entry of the list in config.yaml."""
    if isinstance(entry, str):
        return entry, {}
    if not isinstance(entry, Mapping) or len(entry) != 1:
        raise UserError(
            f"preparation of {record.row.protocol}: each entry is one step with its settings, "
            f"such as 'mask_before: {{time: 0.1 s}}'; found {entry!r}"
        )
    ((name, settings),) = entry.items()
    if settings is not None and not isinstance(settings, Mapping):
        raise UserError(
            f"preparation of {record.row.protocol}, {name}: settings must be 'key: value' pairs, "
            f"found {settings!r}"
        )
    return str(name), settings or {}


def _experiment(record: WorkingRecord, raw: RawRecord) -> Experiment:
    """Make the experiment that the likelihood sees from a prepared record."""
    row, used = record.row, record.used
    if used.sum() < FEWEST_POINTS:
        raise UserError(
            f"preparation of {row.name}: leaves {int(used.sum())} points; mask less of it"
        )
    coordinate = record.coordinate[used]
    knots, values = record.excitation_coordinate, record.excitation
    if not record.in_time:
        knots = values = np.unique(coordinate)
    return Experiment(
        name=row.name,
        protocol=row.protocol,
        role=row.role,
        coordinate_name=record.coordinate_name,
        coordinate_unit=record.coordinate_unit,
        coordinate=coordinate,
        response_name=row.response,
        response_unit=record.response_unit,
        response=record.response[used],
        samples_averaged=record.samples_averaged[used],
        nodes=record.nodes and record.nodes.at(used),
        excitation=Excitation(
            row.excitation,
            record.excitation_unit,
            knots,
            values,
            conditions(row, raw),
            noisy=True,
        ),
        metadata=dict(row.metadata),
        provenance=record.specimen.provenance.get("kind", "measured"),
        record_sha256=raw.sha256,
        steps=record.steps,
        warnings=(*raw.warnings.get(row.name, ()), *record.report.warnings),
    )
