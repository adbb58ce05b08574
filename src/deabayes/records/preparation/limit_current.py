"""Preparation step: from a commanded voltage to the output of a current-limited amplifier."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.faults import UserError
from deabayes.integrate.amplifier import Amplifier
from deabayes.records.preparation.working import Settings, WorkingRecord
from deabayes.systems.specimen_quantities import instrument

LOAD = {"series_resistance": "ohm", "leakage_resistance": "ohm", "capacitance": "F"}


def limit_current(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Treat the voltage as a command, and replace it by the amplifier's output.

    For records that hold the commanded voltage because the amplifier's monitor was not recorded.
    The load has its stated values and is uncharged when the record begins.

    Settings
    --------
    limit : largest current; default `instruments.current_limit` of specimen.yaml.
    series_resistance, leakage_resistance, capacitance : the load; default the specimen's
        `quantities`.
    """
    read = Settings("limit_current", settings, record, ("limit", *LOAD))
    if record.row.excitation != "voltage":
        raise UserError(
            f"{read.where}: only a voltage can be a command to the amplifier; this record's "
            f"excitation is {record.row.excitation!r}: remove the step"
        )
    amplifier = _amplifier(read, record)
    command = record.excitation
    times, values, limited = amplifier.output(record.excitation_coordinate, command)
    share = limited / float(np.ptp(record.excitation_coordinate))
    effect = f"the amplifier is at its limit for {1e3 * limited:.3g} ms, {share:.2%} of the record"
    return replace(
        record,
        excitation_coordinate=np.array(times),
        excitation=np.array(values),
        remarks={"effect": effect},
    )


def _amplifier(read: Settings, record: WorkingRecord) -> Amplifier:
    known = instrument(record.specimen, "current_limit", "current", "A")
    if known is None and not read.has("limit"):
        raise UserError(
            f"{read.where}: give `limit`, or `instruments: current_limit:` in specimen.yaml"
        )
    limit = read.positive("limit", "A", None if known is None else known.value)
    stated = record.specimen.quantities
    missing = [name for name in LOAD if name not in stated and not read.has(name)]
    if missing:
        raise UserError(
            f"{read.where}: give {', '.join(missing)} there or among `quantities` in "
            "specimen.yaml: what the amplifier charges"
        )
    load = (
        read.positive(name, unit, stated[name].value if name in stated else None)
        for name, unit in LOAD.items()
    )
    return Amplifier(limit, *load)
