"""The noise of a record: its group, coordinate, scale, unit and priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Quantity
from deabayes.faults import UserError
from deabayes.noise.base import NoiseModel
from deabayes.prior.distributions import LogNormal
from deabayes.prior.parameter import Parameter
from deabayes.study import Study
from deabayes.systems.base import System
from deabayes.systems.specimen_quantities import instrument

ANGLE = "rad"
SENSOR_NOISE_SIGMA = 0.4
"""Standard deviation of the log of a stated sensor noise: known to a factor of about two."""


@dataclass(frozen=True)
class ResidualScale:
    r"""Map between a response y and its residual r relative to a model's f.

    r = (y - f) / s, or ln(y / f) / s for a response whose errors are proportional to it.

    The second form suits the gain of a frequency response, which spans decades. The logarithm of
    the gains' ratio and the difference of the phases are the real and imaginary part of one
    complex logarithm, that of measured over modelled response. So gain and phase may share one
    noise model. Noise that is stationary in r is, in the gain, largest at the resonance.

    Attributes
    ----------
    scale : s, one for all draws or one per draw (W,).
    proportional : whether r is the logarithm of the ratio.
    """

    scale: FloatArray | float = 1.0
    proportional: bool = False

    def residuals(self, response: FloatArray, mean: FloatArray) -> FloatArray:
        """Return r (W, N) of y (N,) relative to f (W, N); NaN where a ratio is not positive."""
        if not self.proportional:
            return np.asarray((response - mean) / self._column)
        with np.errstate(all="ignore"):
            return np.asarray(np.log(response / mean) / self._column)

    def with_residuals(self, mean: FloatArray, residuals: FloatArray) -> FloatArray:
        """Return y (W, N) with the residuals r (W, N) relative to f (W, N)."""
        if not self.proportional:
            return np.asarray(mean + self._column * residuals)
        return np.asarray(mean * np.exp(self._column * residuals))

    def log_derivative(self, response: FloatArray) -> FloatArray:
        """log |dr/dy| at y (N,), (1, N) or (W, N); add it to log p(r) to get log p(y)."""
        at = -np.log(response) if self.proportional else np.zeros_like(response)
        return np.asarray(at - np.log(self._column))

    def level(self, response: FloatArray) -> FloatArray:
        """Level of y (W, N): y or ln y. Residuals times s are differences of levels."""
        if not self.proportional:
            return response
        return np.asarray(np.log(np.maximum(response, np.finfo(float).tiny)))

    def in_levels(self, residuals: FloatArray) -> FloatArray:
        """Residuals (W, N) as differences of levels."""
        return np.asarray(self._column * residuals)

    def response(self, level: FloatArray) -> FloatArray:
        """Return y of levels of any shape; the inverse of `level`."""
        return np.asarray(np.exp(level)) if self.proportional else level

    @property
    def _column(self) -> FloatArray:
        return np.atleast_1d(np.asarray(self.scale, dtype=float))[:, None]


def noise_group(study: Study, experiment: Experiment) -> str:
    """Name of the group of records with the same noise parameters as this record."""
    return experiment.protocol if study.noise_groups == "protocol" else experiment.name


def noise_coordinate(along: str, experiment: Experiment) -> FloatArray:
    """Coordinate (N,) along which a record's noise is correlated.

    It is the record's own coordinate, or the index of the point on the likelihood's grid. The
    record's coordinate is counted from the first point, because a clock time would cost digits.
    The index suits a grid that is fine at first and coarse later. The error of a model with a few
    relaxation times then also varies fast at first and slowly later, and one correlation time in
    seconds suits neither end.
    """
    if along == "grid":
        return np.arange(experiment.coordinate.size, dtype=float)
    return experiment.coordinate - experiment.coordinate[0]


def record_scale(study: Study, system: System, experiment: Experiment) -> ResidualScale:
    """Scale of a record's residuals: the record's range or 1, and whether they are logarithms.

    Residuals of a gain or an angle have the scale 1, whatever the study's `noise_scale`.
    """
    if is_ratio(system, experiment.response_name):
        return ResidualScale(1.0, experiment.response_name in system.proportional)
    return ResidualScale(experiment.response_range if study.noise_scale == "range" else 1.0)


def correlated_scale(study: Study, system: System, experiment: Experiment) -> float:
    """Unit of the standard deviation of correlated noise, in the unit of a record's residuals.

    With `noise_scale: mixed` it is the record's range, because the error of a model grows with
    the response. A sensor's white noise does not.
    """
    return experiment.response_range if _is_mixed(study, system, experiment) else 1.0


def _is_mixed(study: Study, system: System, experiment: Experiment) -> bool:
    """Whether only the correlated noise of a record is in proportion to its range."""
    return study.noise_scale == "mixed" and not is_ratio(system, experiment.response_name)


def residual_unit(study: Study, system: System, experiment: Experiment) -> str:
    """Unit of a record's residuals."""
    return "1" if _is_relative(study, system, experiment) else experiment.response_unit


def typical_size(study: Study, system: System, experiment: Experiment) -> float:
    """Range of a record's residuals if the model explained nothing."""
    return 1.0 if _is_relative(study, system, experiment) else experiment.response_range


def _is_relative(study: Study, system: System, experiment: Experiment) -> bool:
    return is_ratio(system, experiment.response_name) or study.noise_scale == "range"


def is_ratio(system: System, response: str) -> bool:
    """Whether residuals have no unit in any study, as those of a gain or an angle."""
    return response in system.proportional or system.responses[response] == ANGLE


def noise_parameters(
    study: Study, noise: NoiseModel, experiments: Sequence[Experiment], system: System
) -> tuple[Parameter, ...]:
    """The noise parameters of every group, prefixed by the group's name.

    If all records of a group were read with one sensor, and specimen.yaml states its noise, this
    noise is the median of the white noise's prior, known to a factor of about two.

    Raises
    ------
    UserError : records of one group whose residuals, or coordinates, have different units;
        two readings at the same coordinate, for a noise model without a white part.
    """
    groups: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        groups.setdefault(noise_group(study, experiment), []).append(experiment)
    parameters: list[Parameter] = []
    for group, members in groups.items():
        _check_one_unit(group, "size", {residual_unit(study, system, m) for m in members})
        if noise.length and study.noise_coordinate != "grid":
            _check_one_unit(group, "length", {m.coordinate_unit for m in members})
        scales = [record_scale(study, system, m) for m in members]
        unit = residual_unit(study, system, members[0])
        scale = float(np.mean([typical_size(study, system, m) for m in members]))
        along = [noise_coordinate(study.noise_coordinate, m) for m in members]
        if not noise.has_white:
            _check_no_repeats(noise, members, along)
        span = float(np.median([np.ptp(coordinate) for coordinate in along]))
        coordinate_unit = "1" if study.noise_coordinate == "grid" else members[0].coordinate_unit
        sensor = _stated_noise(system, members)
        divisor = float(np.mean([s.scale for s in scales]))
        made = noise.parameters(unit, scale, span, coordinate_unit)
        if _is_mixed(study, system, members[0]):
            relative = noise.parameters("1", 1.0, span, coordinate_unit)
            pairs = zip(made, relative, strict=True)
            made = tuple(_of_range(share) if p.name == noise.amplitude else p for p, share in pairs)
        parameters += [
            replace(_of_sensor(p, sensor, divisor), name=f"{group}.{p.name}") for p in made
        ]
    return tuple(parameters)


def _of_range(parameter: Parameter) -> Parameter:
    """Return the parameter with a description that says that it is a fraction of the range."""
    return replace(
        parameter, description=f"{parameter.description}, as a fraction of the record's range"
    )


def _check_one_unit(group: str, what: str, units: set[str]) -> None:
    """Refuse a group whose records have the size or length of their noise in different units."""
    if len(units) > 1:
        along = "coordinates in " if what == "length" else "responses in "
        raise UserError(
            f"the records of noise group {group!r} have different units: "
            f"{along}{' and '.join(sorted(units))}. They cannot share the {what} of their noise; "
            "set noise_groups: experiment for the study"
        )


def _check_no_repeats(
    noise: NoiseModel, members: Sequence[Experiment], along: Sequence[FloatArray]
) -> None:
    for experiment, coordinate in zip(members, along, strict=True):
        repeated = np.flatnonzero(np.diff(coordinate) == 0.0)
        if repeated.size:
            at = experiment.coordinate[repeated[0]]
            raise UserError(
                f"record {experiment.name}: {repeated.size} readings repeat their "
                f"{experiment.coordinate_name} (the first at {at:.6g} {experiment.coordinate_unit})"
                f". Noise {noise.name!r} has no white part and cannot explain how they differ; set "
                "noise: ornstein_uhlenbeck or noise_coordinate: grid for the study"
            )


def _stated_noise(system: System, members: Sequence[Experiment]) -> Quantity | None:
    """Sensor noise stated in specimen.yaml; None if residuals are logarithms of ratios.

    It is also None for records of several sensors: they share one size, in no sensor's unit.
    """
    first = members[0]
    several = len({m.response_name for m in members}) > 1
    if several or first.response_name in system.proportional:
        return None
    return instrument(system.specimen, "noise", first.response_name, first.response_unit)


def _of_sensor(parameter: Parameter, sensor: Quantity | None, scale: float) -> Parameter:
    """Return the parameter; for `sigma_white`, with a prior from the sensor's stated noise."""
    if sensor is None or parameter.name != "sigma_white":
        return parameter
    prior = LogNormal(sensor.value / scale, SENSOR_NOISE_SIGMA)
    return replace(parameter, prior=prior, source="noise of the sensor in specimen.yaml")
