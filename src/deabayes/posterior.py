"""The posterior of a candidate given prepared records, vectorised over draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from deabayes.distributions import LogNormal
from deabayes.experiment import Experiment, FloatArray, Quantity, Specimen
from deabayes.noise import REGISTRY as NOISE_MODELS
from deabayes.noise.base import NoiseModel
from deabayes.parameter import Parameter
from deabayes.prior import Prior
from deabayes.reading.instruments import instrument
from deabayes.study import Study
from deabayes.systems import build as build_system
from deabayes.systems.base import Simulator, System

SENSOR_NOISE_SIGMA = 0.4
"""Of the logarithm: a stated sensor noise is known to a factor of about two."""


@dataclass(frozen=True)
class Record:
    """One calibrated experiment with its forward model, noise group and scale."""

    experiment: Experiment
    simulate: Simulator
    group: str
    scale: float
    noise_coordinate: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Variance of each point's white noise relative to one raw sample's."""
        return 1.0 / self.experiment.samples_averaged


@dataclass
class Failures:
    """How many draws were tried, and how many had no finite likelihood."""

    evaluations: int = 0
    failed: int = 0


@dataclass
class LogPosterior:
    r"""log p(theta | y) of one candidate, over records that share its material parameters.

    The model is y_e = f_e(theta) + s_e r_e with r_e from the noise model of the
    record's group and s_e the record's scale (its range, or 1), so that

    log L(theta) = sum_e [ log p_noise((y_e - f_e(theta)) / s_e) - N_e log s_e ].

    Sampling happens in the prior's standard-normal coordinate z (see
    `Prior.to_parameters`): calling the object with z (W, d) gives
    log L(theta(z)) + log N(z; 0, I), whose integral over z is the evidence.
    A draw whose response is not finite has log-probability -inf and is counted.
    """

    system: System
    records: tuple[Record, ...]
    noise: NoiseModel
    prior: Prior
    failures: Failures = field(default_factory=Failures)

    @property
    def names(self) -> tuple[str, ...]:
        return self.prior.names

    @property
    def dimension(self) -> int:
        return len(self.prior.names)

    def draws(self, theta: FloatArray) -> dict[str, FloatArray]:
        """Columns of theta (W, d) by parameter name, each (W,) and contiguous."""
        return dict(zip(self.names, np.ascontiguousarray(theta.T), strict=True))

    def responses(self, theta: FloatArray) -> dict[str, FloatArray]:
        """f_e(theta), (W, N_e), by experiment."""
        draws = self.draws(theta)
        return {record.experiment.name: record.simulate(draws) for record in self.records}

    def pointwise_log_likelihood(self, theta: FloatArray) -> dict[str, FloatArray]:
        """log p(y_k | y_1..k-1, theta), (W, N_e), by experiment."""
        draws = self.draws(theta)
        return {
            record.experiment.name: self.noise.pointwise_log_prob(
                *self._residuals(record, draws), self.noise_draws(draws, record.group)
            )
            - np.log(record.scale)
            for record in self.records
        }

    def log_likelihood(
        self, theta: FloatArray, experiments: Sequence[str] | None = None
    ) -> FloatArray:
        """log L(theta), (W,); `experiments` limits the sum to those records.

        A proposal far outside the prior may overflow: it fails, and is counted, in silence.
        """
        total = np.zeros(theta.shape[0])
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            draws = self.draws(theta)
            for record in self.records:
                if experiments is not None and record.experiment.name not in experiments:
                    continue
                residuals, coordinate, weights = self._residuals(record, draws)
                total += self.noise.log_prob(
                    residuals, coordinate, weights, self.noise_draws(draws, record.group)
                )
                total -= coordinate.size * np.log(record.scale)
        self.failures.evaluations += total.size
        finite = np.isfinite(total)
        self.failures.failed += int(total.size - finite.sum())
        return np.where(finite, total, -np.inf)

    def log_likelihood_of_normal(self, z: FloatArray) -> FloatArray:
        """log L(theta(z)), (W,), for z (W, d) in the standard-normal coordinate."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            theta = self.prior.to_parameters(z)
        return self.log_likelihood(theta)

    def __call__(self, z: FloatArray) -> FloatArray:
        """log L(theta(z)) + log N(z; 0, I), (W,)."""
        return self.log_likelihood_of_normal(z) + log_standard_normal(z)

    def noise_draws(self, draws: Mapping[str, FloatArray], group: str) -> dict[str, FloatArray]:
        """The noise parameters of one group without their prefix."""
        prefix = f"{group}."
        return {name[len(prefix) :]: v for name, v in draws.items() if name.startswith(prefix)}

    def _residuals(
        self, record: Record, draws: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        experiment = record.experiment
        residuals = (experiment.response - record.simulate(draws)) / record.scale
        return residuals, record.noise_coordinate, record.weights


def log_standard_normal(z: FloatArray) -> FloatArray:
    """log N(z; 0, I), (W,), for z (W, d)."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)


def noise_group(study: Study, experiment: Experiment) -> str:
    """The name under which a record shares its noise parameters with others."""
    return experiment.protocol if study.noise_groups == "protocol" else experiment.name


def noise_coordinate(along: str, experiment: Experiment) -> FloatArray:
    """Along what a record's noise is correlated, (N,).

    The record's own coordinate, or the number of the point on the likelihood's grid:
    where that grid is fine at first and coarse later, so is the error of a model with
    a few relaxation times, and a correlation time in seconds suits neither end.
    """
    if along == "grid":
        return np.arange(experiment.coordinate.size, dtype=float)
    return experiment.coordinate


def record_scale(study: Study, response_range: float) -> float:
    """What residuals are divided by: the response's range, or 1."""
    return response_range if study.noise_scale == "range" else 1.0


def noise_parameters(
    study: Study, noise: NoiseModel, experiments: Sequence[Experiment], specimen: Specimen
) -> tuple[Parameter, ...]:
    """The noise parameters of every group, prefixed by the group's name.

    Where specimen.yaml states the sensor's noise, it is the median of the white
    noise's prior, known to a factor of about two.
    """
    groups: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        groups.setdefault(noise_group(study, experiment), []).append(experiment)
    parameters: list[Parameter] = []
    for group, members in groups.items():
        relative = study.noise_scale == "range"
        unit = "1" if relative else members[0].response_unit
        scale = 1.0 if relative else float(np.mean([m.response_range for m in members]))
        along = [noise_coordinate(study.noise_coordinate, m) for m in members]
        span = float(np.median([np.ptp(coordinate) for coordinate in along]))
        coordinate_unit = "1" if study.noise_coordinate == "grid" else members[0].coordinate_unit
        sensor = instrument(specimen, "noise", members[0].response_name, members[0].response_unit)
        ranges = float(np.mean([m.response_range for m in members])) if relative else 1.0
        parameters += [
            replace(_of_sensor(p, sensor, ranges), name=f"{group}.{p.name}")
            for p in noise.parameters(unit, scale, span, coordinate_unit)
        ]
    return tuple(parameters)


def _of_sensor(parameter: Parameter, sensor: Quantity | None, scale: float) -> Parameter:
    """The white noise's parameter with the sensor's stated noise as its prior."""
    if sensor is None or parameter.name != "sigma_white":
        return parameter
    prior = LogNormal(sensor.value / scale, SENSOR_NOISE_SIGMA)
    return replace(parameter, prior=prior, source="noise of the sensor in specimen.yaml")


def build(
    study: Study,
    candidate: str,
    specimen: Specimen,
    experiments: Sequence[Experiment],
    inherited: tuple[tuple[str, ...], FloatArray] | None = None,
) -> LogPosterior:
    """Put a candidate and its calibration records together.

    Parameters
    ----------
    experiments : prepared records; only those with role `calibrate` are used.
    inherited : names and draws (S, k) of another study's posterior that becomes
        the prior of the parameters of those names, correlations kept.
    """
    system = build_system(specimen.system, candidate, specimen)
    noise = NOISE_MODELS[study.noise]()
    calibrate = [e for e in experiments if e.role == "calibrate"]
    records = tuple(
        Record(
            e,
            system.simulator(e.excitation, e.coordinate, e.response_name),
            noise_group(study, e),
            record_scale(study, e.response_range),
            noise_coordinate(study.noise_coordinate, e),
        )
        for e in calibrate
    )
    parameters = (*system.parameters(), *noise_parameters(study, noise, calibrate, specimen))
    others = (
        parameter.name
        for other in study.candidates
        for parameter in build_system(specimen.system, other, specimen).parameters()
    )
    prior = Prior.from_parameters(parameters, study.priors, also_known=tuple(others))
    if inherited is not None:
        prior = prior.inherit(*inherited)
    return LogPosterior(system, records, noise, prior)
