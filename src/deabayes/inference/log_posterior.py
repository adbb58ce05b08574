"""The posterior of a candidate given prepared records, vectorised over draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.inference.default_priors import adapted_to_records, names_of_all, only_for_predictions
from deabayes.inference.record_noise import (
    ResidualScale,
    correlated_scale,
    noise_coordinate,
    noise_group,
    noise_parameters,
    record_scale,
)
from deabayes.noise import REGISTRY as NOISE_MODELS
from deabayes.noise.base import Draws, NoiseModel
from deabayes.prior.joint import Prior, PriorFromPosterior
from deabayes.study import Study
from deabayes.systems import build as build_system
from deabayes.systems.base import Batch, Simulator, System


@dataclass(frozen=True)
class Record:
    """One calibrated experiment with its forward model, noise group and scale."""

    experiment: Experiment
    simulate: Simulator
    group: str
    scale: ResidualScale
    noise_coordinate: FloatArray
    correlated_scale: float = 1.0

    @cached_property
    def weights(self) -> FloatArray:
        """Variance of each point's white noise relative to one raw sample's."""
        return 1.0 / self.experiment.samples_averaged

    @cached_property
    def log_derivative(self) -> FloatArray:
        """log |dr/dy| at the measured responses, (1, N), for the residuals r."""
        return self.scale.log_derivative(self.experiment.response)

    def solved_by(self, system: System) -> Record:
        """Return the same record with the forward model of `system`."""
        return replace(self, simulate=system.simulator_of(self.experiment))


@dataclass(frozen=True)
class LogPosterior:
    r"""log p(theta | y) of one candidate, over records that share its material parameters.

    The model is y_e = f_e(theta) + s_e r_e with r_e from the noise model of the
    record's group and s_e the record's scale (its range, or 1), so that

    log L(theta) = sum_e [ log p_noise((y_e - f_e(theta)) / s_e) - N_e log s_e ],

    with ln(y_e / f_e) in place of y_e - f_e if a response's errors are proportional to the
    response (see `ResidualScale`).

    Sampling happens in the prior's standard-normal coordinate z (see
    `Prior.to_parameters`). Calling the object with z (W, d) gives
    log L(theta(z)) + log N(z; 0, I), whose integral over z is the evidence. A correction is
    added if theta(z) maps N(0, I) to the prior only approximately (see `Prior.log_correction`).
    A draw whose response is not finite has log-probability -inf.
    """

    system: System
    records: tuple[Record, ...]
    noise: NoiseModel
    prior: Prior
    quantities_counted: bool = False
    """Whether the prior already includes the data on the specimen itself."""

    @property
    def names(self) -> tuple[str, ...]:
        return self.prior.names

    @property
    def dimension(self) -> int:
        return len(self.prior.names)

    def draws(self, theta: FloatArray) -> Batch:
        """Columns of theta (W, d) by parameter name, each (W,) and contiguous."""
        return Batch(dict(zip(self.names, np.ascontiguousarray(theta.T), strict=True)))

    def responses(self, theta: FloatArray) -> dict[str, FloatArray]:
        """f_e(theta), (W, N_e), by experiment."""
        draws = self.draws(theta)
        return {record.experiment.name: record.simulate(draws) for record in self.records}

    def pointwise_log_likelihood(self, theta: FloatArray) -> dict[str, FloatArray]:
        """log p(y_k | y_1..k-1, theta), (W, N_e), by experiment."""
        draws = self.draws(theta)
        return {
            record.experiment.name: self.noise.pointwise_log_prob(
                *self.residuals(record, draws), self.noise_draws(draws, record)
            )
            + record.log_derivative
            for record in self.records
        }

    def log_likelihood(
        self, theta: FloatArray, experiments: Sequence[str] | None = None
    ) -> FloatArray:
        """log L(theta), (W,), of all records or of those in `experiments`.

        With `experiments`, the data on the specimen itself
        (`System.log_likelihood_of_quantities`) are left out. A proposal far outside the prior may
        overflow. It then fails without a warning.
        """
        total = np.zeros(theta.shape[0])
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            draws = self.draws(theta)
            for record in self.records:
                if experiments is not None and record.experiment.name not in experiments:
                    continue
                residuals, coordinate, weights = self.residuals(record, draws)
                total += self.noise.log_prob(
                    residuals, coordinate, weights, self.noise_draws(draws, record)
                )
                total += record.log_derivative.sum()
            if experiments is None and not self.quantities_counted:
                total += self.system.log_likelihood_of_quantities(draws)
        return np.where(np.isfinite(total), total, -np.inf)

    def log_density_beside_records(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        """Terms of the log-posterior other than the records and N(z; 0, I), (W,).

        These are the log-likelihood of the data on the specimen itself, and the correction of an
        inherited prior.
        """
        total = self.prior.log_correction(theta, z)
        if not self.quantities_counted:
            total = total + self.system.log_likelihood_of_quantities(self.draws(theta))
        return np.asarray(total)

    def log_likelihood_of_normal(self, z: FloatArray) -> FloatArray:
        """log [L(theta) p(theta) / q(theta)], (W,), for z (W, d) in the standard-normal coordinate.

        q is the density of theta(z) for z ~ N(0, I). It equals the prior p, except for some
        inherited priors (`Prior.log_correction`).
        """
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            theta = self.prior.to_parameters(z)
            return self.log_likelihood(theta) + self.prior.log_correction(theta, z)

    def __call__(self, z: FloatArray) -> FloatArray:
        """log [L(theta(z)) p / q] + log N(z; 0, I), (W,)."""
        return self.log_likelihood_of_normal(z) + log_standard_normal(z)

    def rough(self) -> LogPosterior:
        """Return the same posterior with a faster, less accurate solver, for dropped draws."""
        system = self.system.for_likelihood(rough=True)
        if system is self.system:
            return self
        return replace(self, records=tuple(record.solved_by(system) for record in self.records))

    def noise_draws(self, draws: Draws, record: Record) -> Draws:
        """The noise parameters of a record, without its group's prefix."""
        prefix = f"{record.group}."
        named = {name[len(prefix) :]: v for name, v in draws.items() if name.startswith(prefix)}
        return self.noise.for_record(named, record.correlated_scale)

    def residuals(
        self, record: Record, draws: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals (W, N), and the noise model's coordinate (N,) and weights (N,)."""
        experiment = record.experiment
        residuals = record.scale.residuals(experiment.response, record.simulate(draws))
        return residuals, record.noise_coordinate, record.weights


def log_standard_normal(z: FloatArray) -> FloatArray:
    """log N(z; 0, I), (W,), for z (W, d)."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)


def build(
    study: Study,
    candidate: str,
    specimen: Specimen,
    experiments: Sequence[Experiment],
    inherited: PriorFromPosterior | None = None,
    quantities_counted: bool = False,
) -> LogPosterior:
    """Build the log-posterior of a candidate from its calibration records.

    Parameters
    ----------
    experiments : prepared records; only those with role `calibrate` are used.
    inherited : names and draws (S, k) of another study's posterior, which becomes the
        joint prior of the parameters of these names.
    quantities_counted : whether the inherited posterior is of the same specimen.
    """
    system = build_system(specimen.system, candidate, specimen)
    solved, noise = system.for_likelihood(), NOISE_MODELS[study.noise]()
    calibrated = [e for e in experiments if e.role == "calibrate"]
    records = tuple(
        Record(
            e,
            solved.simulator_of(e),
            noise_group(study, e),
            record_scale(study, system, e),
            noise_coordinate(study.noise_coordinate, e),
            correlated_scale(study, system, e),
        )
        for e in calibrated
    )
    names = () if inherited is None else inherited.names
    material = adapted_to_records(system.parameters(), system, calibrated, study.priors, names)
    parameters = (*material, *noise_parameters(study, noise, calibrated, system))
    prior = Prior.from_parameters(parameters, study.priors, names_of_all(study, specimen))
    if inherited is not None and not only_for_predictions(inherited, prior, study, specimen):
        prior = prior.inherit(*inherited)
    return LogPosterior(system, records, noise, prior, quantities_counted=quantities_counted)
