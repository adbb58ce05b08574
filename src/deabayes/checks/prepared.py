"""Checks of prepared records: coarse excitations, and influences that no model includes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import Report, UserError
from deabayes.quantities import with_unit
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.systems.base import System
from deabayes.systems.specimen_quantities import instrument

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, Experiment, Specimen
    from deabayes.records.folder import StudyFolder
    from deabayes.study import Study

CAUSES = ("voltage", "control_voltage", "stretch", "displacement", "force")
"""Channels that cause a response. Others, such as a current, are responses themselves."""
STATED = {"voltage_kV": "voltage", "bias_kV": "voltage", "amplitude_kV": "voltage"}
"""Columns of experiments.csv that state a channel."""
AROUND = ("temperature", "humidity")
"""Beginnings of column names for influences on a material that no shipped model includes."""
HELD = 0.02
"""Largest change of a channel that counts as constant, as a share of its largest value."""
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


def warn_if_coarse(excitation: Excitation, report: Report) -> None:
    """Warn if straight lines describe an excitation badly."""
    missed = missed_by_lines(excitation) if excitation.in_time else 0.0
    if missed > LARGEST_MISS:
        report.warn(
            f"straight lines between the samples of the {excitation.name} miss "
            f"{100 * missed:.2g} % of its range (rms), so predicted amplitudes are too small; "
            "record at least 30 samples per period"
        )


def prepared_records(
    study: Study, read: StudyFolder, rows: Sequence[ExperimentRow], report: Report
) -> list[Experiment]:
    """Return the prepared records, and report faults and warnings of steps, each once.

    `StudyFolder.warnings` has the warnings of the records themselves.
    """
    from deabayes.records.preparation import measured_rows, prepare
    from deabayes.records.preparation.defaults import with_idle_masks

    experiments: list[Experiment] = []
    of_records: set[str] = set()
    faults: dict[str, str] = {}
    for row in rows:
        raw, steps = read.record(row), study.preparation.get(row.protocol)
        of_records.update(*raw.warnings.values())
        try:
            for measured in measured_rows(row, raw):
                experiments.append(prepare(measured, raw, read.specimen, steps, report))
        except UserError as error:
            faults[str(error).replace(row.name, "")] = str(error)
    report.include(faults.values())
    for experiment in experiments if faults else with_idle_masks(experiments):
        for warning in experiment.warnings:
            if warning not in of_records:
                report.warn(warning, experiment.name)
    for experiment in experiments:
        _warn_of_delay(read.specimen, experiment, report)
    for experiment in experiments:
        warn_if_coarse(experiment.excitation, report.at(experiment.name))
    return experiments


def _warn_of_delay(specimen: Specimen, experiment: Experiment, report: Report) -> None:
    """Warn if no step removes a sensor's delay; the default steps would."""
    name = experiment.response_name
    sensor = instrument(specimen, "delay", name, "s")
    late = experiment.coordinate_name == "time" or name == "phase"
    removed = any(step["step"] == "delay" for step in experiment.steps)
    if sensor is not None and sensor.value != 0.0 and late and not removed:
        report.warn(
            f"the {name}'s delay of {with_unit(sensor.value, 's')}, stated in specimen.yaml, "
            "stays in the records, as none of the steps is `delay`; add `delay: {}` as the first "
            "of them, or, if the records have no delay, remove it from specimen.yaml",
            f"preparation.{experiment.protocol}",
        )


def unmodelled(
    system: type[System], records: Sequence[tuple[ExperimentRow, RawRecord]], report: Report
) -> None:
    """Report channels and conditions that vary within or between records and are in no model.

    Without this check, their effect on the response would silently be attributed to other
    causes.
    """
    modelled = {"time", *system.excitations, *system.responses}
    for name in CAUSES:
        if COMMANDS.get(name, name) not in modelled:
            _check_channel(name, system, records, report)
    conditions = {name for names in (system.conditions or {}).values() for name in names}
    for name in dict.fromkeys(name for row, _ in records for name in row.metadata):
        is_channel = name in STATED and STATED[name] not in modelled
        if name not in conditions and (is_channel or name.lower().startswith(AROUND)):
            _check_condition(name, system, [row for row, _ in records], report)


def _check_channel(
    name: str,
    system: type[System],
    records: Sequence[tuple[ExperimentRow, RawRecord]],
    report: Report,
) -> None:
    """Report a column of records, such as the voltage of a system that voltage does not drive."""
    having = {row.name: raw for row, raw in records if name in raw.columns}
    if not having:
        return
    values = np.concatenate([raw.columns[name] for raw in having.values()])
    low, high, largest = (float(f(values)) for f in (np.min, np.max, lambda v: np.max(np.abs(v))))
    constant = high - low <= HELD * largest and len(having) == len(records)
    if constant or largest == 0.0:
        return
    unit = next(iter(having.values())).units[name]
    report.fault(
        f"goes from {with_unit(low, unit, name, 3)} to {with_unit(high, unit, name, 3)}, and "
        f"system {system.name!r} has no {name}: its effect would be attributed to the material. "
        f"Fit records of one {name} only (`select` or `calibrate` and `validate`), or leave it "
        f"out by `columns: {name} = -` in experiments.csv",
        f"column {name} of {', '.join(having)}",
    )


def _check_condition(
    name: str, system: type[System], rows: Sequence[ExperimentRow], report: Report
) -> None:
    """Report a column of experiments.csv, such as a stated voltage or a temperature."""
    values = sorted({str(row.metadata.get(name, "nothing")) for row in rows})
    if len(values) > 1:
        report.fault(
            f"is {', '.join(values)} over the records, and no model of system {system.name!r} "
            f"includes it: its effect would be attributed to the material. Fit records of one "
            f"{name} only (`select: {{{name}: {values[0]}}}`, or `split_by: {name}`)",
            f"column {name} of experiments.csv",
        )
