"""Preparation of a record before inference, as a sequence of named steps.

The raw file is never changed. A step is a function of a record and of its settings in
config.yaml. Each step has its own file and one line in `REGISTRY`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.faults import UserError, nearest
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation.average import average
from deabayes.records.preparation.cycles import cycles
from deabayes.records.preparation.defaults import DEFAULT_STEPS, default_steps
from deabayes.records.preparation.excitation_knots import excitation_knots
from deabayes.records.preparation.excitation_spline import excitation_spline
from deabayes.records.preparation.limit_current import limit_current
from deabayes.records.preparation.masks import (
    mask_after,
    mask_before,
    mask_between,
    mask_ramp_end,
    mask_slack,
)
from deabayes.records.preparation.response import baseline, delay, scale
from deabayes.records.preparation.rest import begins_apart, drift_at_rest, reading_at_rest
from deabayes.records.preparation.selection import crop, decimate
from deabayes.records.preparation.take_up_slack import slack_left_in, take_up_slack
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
) -> Experiment:
    """Prepare one raw record for inference.

    Parameters
    ----------
    row : the record's row of experiments.csv.
    raw : the record's columns in SI.
    specimen : what was tested; `instruments.delay` is used by the step `delay`.
    steps : ordered single-key mappings {step: settings}; a bare name is a step
        without settings; None takes the default steps (`defaults`).

    Raises
    ------
    UserError : unknown step or setting, wrong unit, missing column, no samples left.
    Faults : all faults of the record's values.
    """
    record = open_record(row, raw, specimen)
    slack, apart, rest = slack_left_in(record), begins_apart(record), reading_at_rest(record)
    drift = drift_at_rest(record)
    if rest is not None and (not rest.is_offset or (slack and not rest.seen)):
        rest = None
    usual = default_steps(record, rest is not None and rest.seen) if steps is None else steps
    for entry in usual:
        record = _apply(entry, record)
    done = {str(entry["step"]) for entry in record.steps}
    if rest is not None and (steps is None or "baseline" not in done):
        record = record.with_warning(rest.sentence("baseline" in done))
    if drift:
        record = record.with_warning(drift)
    for step, sentence in (("take_up_slack", slack), ("delay", apart)):
        if sentence and step not in done:
            record = record.with_warning(sentence)
    return _experiment(record, raw)


def _apply(entry: Mapping[str, object] | str, record: WorkingRecord) -> WorkingRecord:
    """Apply one step and add it to the record's history."""
    name, settings = _parsed(entry, record)
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
        warnings=record.warnings,
    )
