"""A study's records as its preparation leaves them, and what there is to say of that."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deabayes.checks.coarse_excitation import too_coarse
from deabayes.faults import UserError
from deabayes.instruments import instrument
from deabayes.quantities import with_unit

if TYPE_CHECKING:
    from deabayes.experiment import Experiment, Specimen
    from deabayes.reading.folder import StudyFolder
    from deabayes.reading.raw import ExperimentRow
    from deabayes.study import Study


def prepared_records(
    study: Study, read: StudyFolder, rows: Sequence[ExperimentRow]
) -> tuple[list[Experiment], list[str], list[str]]:
    """The records as the likelihood will see them; each fault of a step, said once; warnings.

    Warnings are those of the steps: what a record itself is warned of is its folder's.
    """
    from deabayes.preparation import measured_rows, prepare
    from deabayes.preparation.idle_masks import with_idle_masks

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
    """A sensor's delay that no step takes out; the usual steps do."""
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
