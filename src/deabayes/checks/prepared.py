"""Checks of prepared records: coarse excitations, and influences that no model includes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.quantities import with_unit
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.systems.base import System
from deabayes.systems.specimen_quantities import instrument

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, Experiment, Specimen
    from deabayes.records.folder import StudyFolder
    from deabayes.study import Study

LARGEST_MISS = 0.002
"""Largest rms error as a share of the excitation's range: a sine with 28 samples per period."""
FEWEST_SAMPLES = 16
LAGS = (1, 3)


def missed_by_lines(excitation: Excitation) -> float:
    r"""RMS error of straight lines between samples of a curved excitation, over its range.

    A sample lies d_k off the line between its neighbours. Half way between two samples of a
    smooth curve, a line is off by d/4. For a smooth curve, d_k d_{k+m} is positive for small m.
    A jump, a corner and a monitor's noise contribute nothing: the mean of their products is
    negative or zero for neighbours (m = 1), and zero beyond the reach of a sample's own noise
    (m = 3).
    """
    at, values = excitation.coordinate, excitation.values
    extent = float(np.ptp(values))
    if values.size < FEWEST_SAMPLES or extent == 0.0:
        return 0.0
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    off = values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:]
    together = max(_surely(off[lag:] * off[:-lag]) for lag in LAGS)
    return 0.25 * float(np.sqrt(together)) / extent


def _surely(products: FloatArray) -> float:
    """Return the mean if it exceeds zero by more than three standard errors, else zero."""
    mean, error = float(np.mean(products)), float(np.std(products)) / np.sqrt(products.size)
    return mean if mean > 3.0 * error else 0.0


def too_coarse(excitation: Excitation) -> str | None:
    """Warning if straight lines describe an excitation badly; else None."""
    missed = missed_by_lines(excitation) if excitation.in_time else 0.0
    if missed <= LARGEST_MISS:
        return None
    return (
        f"between its samples the {excitation.name} is taken for straight lines, which miss "
        f"{100 * missed:.2g} % of its range (rms): predicted amplitudes come out too small; log "
        "the drive at 30 samples a period and more"
    )


def prepared_records(
    study: Study, read: StudyFolder, rows: Sequence[ExperimentRow]
) -> tuple[list[Experiment], list[str], list[str]]:
    """Return the prepared records, the faults of steps (each once), and warnings.

    The warnings concern the steps only. `StudyFolder.warnings` has the warnings of the records.
    """
    from deabayes.records.preparation import measured_rows, prepare
    from deabayes.records.preparation.defaults import with_idle_masks

    measured: list[ExperimentRow] = []
    experiments: list[Experiment] = []
    faults: dict[str, str] = {}
    for row in rows:
        try:
            raw, steps = read.record(row), study.preparation.get(row.protocol)
            for each in measured_rows(row, raw):
                experiments.append(prepare(each, raw, read.specimen, steps))
                measured.append(each)
        except UserError as error:
            faults[str(error).replace(row.name, "")] = f"study {study.name}, {error}"
    experiments = experiments if faults else with_idle_masks(experiments)
    warnings = [
        warning
        for row, each in zip(measured, experiments, strict=True)
        for warning in _of_steps(study, row, each)
    ]
    late = [line for each in experiments for line in _delay_left_in(study, read.specimen, each)]
    coarse = [
        f"study {study.name}, {each.name}: {said}"
        for each in experiments
        if (said := too_coarse(each.excitation))
    ]
    return experiments, list(faults.values()), [*warnings, *dict.fromkeys(late), *coarse]


def _of_steps(study: Study, row: ExperimentRow, experiment: Experiment) -> list[str]:
    of_the_record = f"{row.record} ({row.name})"
    return [
        f"study {study.name}, {row.name}: {warning}"
        for warning in experiment.warnings
        if not warning.startswith(of_the_record)
    ]


def _delay_left_in(study: Study, specimen: Specimen, experiment: Experiment) -> list[str]:
    """Warning: no step removes a sensor's delay; the default steps would."""
    name, protocol = experiment.response_name, experiment.protocol
    sensor = instrument(specimen, "delay", name, "s")
    late = experiment.coordinate_name == "time" or name == "phase"
    done = any(step["step"] == "delay" for step in experiment.steps)
    if sensor is None or sensor.value == 0.0 or not late or done:
        return []
    return [
        f"study {study.name}, preparation.{protocol}: the {name}'s delay of "
        f"{with_unit(sensor.value, 's')}, stated in specimen.yaml, stays in the records, as none "
        "of the steps is `delay`; add `delay: {}` as the first of them, or, if the records have no "
        "delay, remove it from specimen.yaml"
    ]


CAUSES = ("voltage", "control_voltage", "stretch", "displacement", "force")
"""Channels that cause a response. Others, such as a current, are responses themselves."""
STATED = {"voltage_kV": "voltage", "bias_kV": "voltage", "amplitude_kV": "voltage"}
"""Columns of experiments.csv that state a channel."""
AROUND = ("temperature", "humidity")
"""Beginnings of column names for influences on a material that no shipped model includes."""
HELD = 0.02
"""Largest change of a channel that counts as constant, as a share of its largest value."""


def unmodelled(
    system: type[System], records: Sequence[tuple[ExperimentRow, RawRecord]], study: str
) -> list[str]:
    """Faults: channels and conditions that vary within or between records and are in no model.

    Without this check, their effect on the response would silently be attributed to other
    causes.
    """
    found = [*_channels(system, records), *_conditions(system, [row for row, _ in records])]
    return [f"study {study}, {each}" for each in found]


def _known(system: type[System]) -> set[str]:
    return {"time", *system.excitations, *system.responses}


def _channels(
    system: type[System], records: Sequence[tuple[ExperimentRow, RawRecord]]
) -> list[str]:
    """Faults: columns of records, such as the voltage of a system that voltage does not drive."""
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
            f"{system.name!r} has no {name}: its effect would be attributed to the material. "
            f"Fit records of one {name} only (`select` or `calibrate` and `validate`), "
            f"or leave it out by `columns: {name} = -` in experiments.csv"
        )
    return faults


def _conditions(system: type[System], rows: Sequence[ExperimentRow]) -> list[str]:
    """Faults: columns of experiments.csv, such as a stated voltage or a temperature."""
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
                f"no model of system {system.name!r} includes it: its effect would be attributed "
                f"to the material. Fit records of one {name} only (`select: {{{name}: "
                f"{values[0]}}}`, or `split_by: {name}`)"
            )
    return faults


def _is_constant(values: FloatArray) -> bool:
    return float(np.ptp(values)) <= HELD * float(np.max(np.abs(values)))
