"""Which noise a record has: its group, its scale, along what it is correlated, its priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deabayes.distributions import LogNormal
from deabayes.experiment import Experiment, FloatArray, Quantity
from deabayes.faults import UserError
from deabayes.instruments import instrument
from deabayes.noise.base import NoiseModel
from deabayes.parameter import Parameter
from deabayes.residual_scale import ResidualScale
from deabayes.study import Study
from deabayes.systems.base import System

ANGLE = "rad"
SENSOR_NOISE_SIGMA = 0.4
"""Of the logarithm: a stated sensor noise is known to a factor of about two."""


def noise_group(study: Study, experiment: Experiment) -> str:
    """The name under which a record shares its noise parameters with others."""
    return experiment.protocol if study.noise_groups == "protocol" else experiment.name


def noise_coordinate(along: str, experiment: Experiment) -> FloatArray:
    """Along what a record's noise is correlated, (N,).

    The record's own coordinate from its first point on, since what is computed with a clock time
    loses digits, or the number of the point on the likelihood's grid:
    where that grid is fine at first and coarse later, so is the error of a model with
    a few relaxation times, and a correlation time in seconds suits neither end.
    """
    if along == "grid":
        return np.arange(experiment.coordinate.size, dtype=float)
    return experiment.coordinate - experiment.coordinate[0]


def record_scale(study: Study, system: System, experiment: Experiment) -> ResidualScale:
    """What a record's residuals are: divided by its range or as they are, or logarithms of ratios.

    Those of frequency responses are relative in themselves, whatever the study's `noise_scale`.
    """
    if is_ratio(system, experiment.response_name):
        return ResidualScale(1.0, experiment.response_name in system.proportional)
    return ResidualScale(experiment.response_range if study.noise_scale == "range" else 1.0)


def residual_unit(study: Study, system: System, experiment: Experiment) -> str:
    """Unit of a record's residuals."""
    relative = is_ratio(system, experiment.response_name) or study.noise_scale == "range"
    return "1" if relative else experiment.response_unit


def typical_size(study: Study, system: System, experiment: Experiment) -> float:
    """The range of a record's residuals were the model to explain nothing of it."""
    relative = is_ratio(system, experiment.response_name) or study.noise_scale == "range"
    return 1.0 if relative else experiment.response_range


def is_ratio(system: System, response: str) -> bool:
    """Whether residuals are plain numbers whatever the study says: of a gain, or of an angle."""
    return response in system.proportional or system.responses[response] == ANGLE


def noise_parameters(
    study: Study, noise: NoiseModel, experiments: Sequence[Experiment], system: System
) -> tuple[Parameter, ...]:
    """The noise parameters of every group, prefixed by the group's name.

    Where specimen.yaml states the sensor's noise, it is the median of the white
    noise's prior, known to a factor of about two.

    Raises
    ------
    UserError : records of one group whose residuals have different units.
    """
    groups: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        groups.setdefault(noise_group(study, experiment), []).append(experiment)
    parameters: list[Parameter] = []
    for group, members in groups.items():
        _check_one_unit(group, {residual_unit(study, system, m) for m in members})
        scales = [record_scale(study, system, m) for m in members]
        unit = residual_unit(study, system, members[0])
        scale = float(np.mean([typical_size(study, system, m) for m in members]))
        along = [noise_coordinate(study.noise_coordinate, m) for m in members]
        span = float(np.median([np.ptp(coordinate) for coordinate in along]))
        coordinate_unit = "1" if study.noise_coordinate == "grid" else members[0].coordinate_unit
        sensor = _stated_noise(system, members[0])
        divisor = float(np.mean([s.scale for s in scales]))
        parameters += [
            replace(_of_sensor(p, sensor, divisor), name=f"{group}.{p.name}")
            for p in noise.parameters(unit, scale, span, coordinate_unit)
        ]
    return tuple(parameters)


def _check_one_unit(group: str, units: set[str]) -> None:
    """Records that share an amplitude must have it in one unit."""
    if len(units) > 1:
        raise UserError(
            f"noise group {group!r} has records in {' and in '.join(sorted(units))}, which cannot "
            "share the size of their noise; set noise_groups: experiment for the study"
        )


def _stated_noise(system: System, experiment: Experiment) -> Quantity | None:
    """The sensor's noise as specimen.yaml states it, where residuals are differences."""
    if experiment.response_name in system.proportional:
        return None
    name, unit = experiment.response_name, experiment.response_unit
    return instrument(system.specimen, "noise", name, unit)


def _of_sensor(parameter: Parameter, sensor: Quantity | None, scale: float) -> Parameter:
    """The white noise's parameter with the sensor's stated noise as its prior."""
    if sensor is None or parameter.name != "sigma_white":
        return parameter
    prior = LogNormal(sensor.value / scale, SENSOR_NOISE_SIGMA)
    return replace(parameter, prior=prior, source="noise of the sensor in specimen.yaml")
