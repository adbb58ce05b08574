"""What changes over the records and is in no model of the system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit
from deabayes.reading.columns import COMMANDS
from deabayes.reading.raw import ExperimentRow, RawRecord
from deabayes.systems.base import System

CAUSES = ("voltage", "control_voltage", "stretch", "displacement", "force")
"""Channels that make a response; a current, say, is one itself."""
STATED = {"voltage_kV": "voltage", "bias_kV": "voltage", "amplitude_kV": "voltage"}
"""Columns of experiments.csv that state a channel."""
AROUND = ("temperature", "humidity")
"""What a material depends on and no model here: columns of experiments.csv that begin so."""
HELD = 0.02
"""Of its largest value: what a channel may change and count as constant."""


def unmodelled(
    system: type[System], records: Sequence[tuple[ExperimentRow, RawRecord]], study: str
) -> list[str]:
    """Faults: channels and conditions that differ within records or between them, unknown to all.

    A response that depends on them is put down to something else, in silence.
    """
    found = [*_channels(system, records), *_conditions(system, [row for row, _ in records])]
    return [f"study {study}, {each}" for each in found]


def _known(system: type[System]) -> set[str]:
    return {"time", *system.excitations, *system.responses}


def _channels(
    system: type[System], records: Sequence[tuple[ExperimentRow, RawRecord]]
) -> list[str]:
    """Columns of records; a voltage of a system that voltage does not drive, say."""
    faults = []
    known = _known(system)
    for name in CAUSES:
        if COMMANDS.get(name, name) in known:
            continue
        columns = {row.name: raw for row, raw in records if name in raw.columns}
        values = [raw.columns[name] for raw in columns.values()]
        if not values or (_is_constant(np.concatenate(values)) and len(columns) == len(records)):
            continue
        if not any(np.any(each != 0.0) for each in values):
            continue
        low, high = min(map(np.min, values)), max(map(np.max, values))
        unit = next(iter(columns.values())).units[name]
        span = f"{with_unit(float(low), unit, name, 3)} to {with_unit(float(high), unit, name, 3)}"
        faults.append(
            f"column {name} of {', '.join(columns)}: goes from {span}, and system "
            f"{system.name!r} has no {name}: what it does to the response would be put down to the "
            f"material. Fit records of one {name} only (`select` or `calibrate` and `validate`), "
            f"or pass it over by `columns: {name} = -` in experiments.csv"
        )
    return faults


def _conditions(system: type[System], rows: Sequence[ExperimentRow]) -> list[str]:
    """Columns of experiments.csv: a stated voltage, a temperature."""
    told = {name for names in (system.conditions or {}).values() for name in names}
    faults = []
    for name in dict.fromkeys(name for row in rows for name in row.metadata):
        channel = STATED.get(name)
        unknown = channel is not None and channel not in _known(system)
        if name in told or not (unknown or name.lower().startswith(AROUND)):
            continue
        values = sorted({str(row.metadata.get(name, "nothing")) for row in rows})
        if len(values) > 1:
            faults.append(
                f"column {name} of experiments.csv: is {', '.join(values)} over the records, and "
                f"no model of system {system.name!r} knows of it: what it does to the response "
                f"would be put down to the material. Fit records of one {name} only (`select: "
                f"{{{name}: {values[0]}}}`, or `split_by: {name}`)"
            )
    return faults


def _is_constant(values: FloatArray) -> bool:
    return float(np.ptp(values)) <= HELD * float(np.max(np.abs(values)))
