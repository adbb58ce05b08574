"""Simulated specimens: what is known of them beforehand, their records, and their noise.

A world is a family of models with the priors of somebody who has an idea of the material,
and blank records that a specimen drawn from those priors is put through. The worlds of each
system are in `membrane_worlds`, `tubular_worlds` and `structure_worlds`.

The noise is drawn from the noise priors at the scale of the records of the prior's median
specimen, one set of noise parameters for all records of a protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Role, Specimen
from deabayes.inference.log_posterior import LogPosterior, Record, build
from deabayes.inference.record_noise import ResidualScale
from deabayes.study import Settings, Study

SmoothIn = Callable[[Experiment], FloatArray]
"""Coordinate (N,) of a record in which a model's error is smooth over a length of 1."""
ERROR_SHARE = 0.01
"""Standard deviation of that error, as a share of the record's range."""
NoiseGroups = Literal["protocol", "experiment"]
NoiseScale = Literal["mixed", "absolute", "range"]
OU = "ornstein_uhlenbeck"


@dataclass(frozen=True)
class World:
    """Models `{family}_{n}{ending}` of a specimen, and blank records of it.

    Attributes
    ----------
    priors : from the number of units to the priors of a model with as many.
    records, held_out : experiments whose response is still to be simulated.
    smooth_in : coordinate of the smooth error that no candidate has, if one is asked for.
    """

    family: str
    specimen: Specimen
    priors: Callable[[int], Mapping[str, Settings]]
    records: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...] = ()
    noise_groups: NoiseGroups = "protocol"
    noise_scale: NoiseScale = "mixed"
    ending: str = ""
    smooth_in: SmoothIn = field(default_factory=lambda: log_time)

    def target(self, order: int, noise: str = OU) -> LogPosterior:
        """Log-posterior whose records are the median specimen's, which sets the noise priors."""
        blank = self.conditioned(order, self.records, noise)
        median = blank.prior.to_parameters(np.zeros((1, blank.dimension)))
        curves = blank.responses(median)
        records = [replace(e, response=curves[e.name][0]) for e in self.records]
        return self.conditioned(order, records, noise)

    def conditioned(
        self, order: int, records: Sequence[Experiment], noise: str = OU
    ) -> LogPosterior:
        """Log-posterior given records, as a study would put it together."""
        candidate = f"{self.family}_{order}{self.ending}"
        study = Study(
            "validation",
            Path(),
            (candidate,),
            noise=noise,
            noise_groups=self.noise_groups,
            noise_scale=self.noise_scale,
            priors=self.priors(order),
        )
        return build(study, candidate, self.specimen, records)


def given(target: LogPosterior, experiments: Sequence[Experiment]) -> LogPosterior:
    """The target conditioned on these records instead of its own, priors unchanged."""
    named = {experiment.name: experiment for experiment in experiments}
    records = (replace(r, experiment=named[r.experiment.name]) for r in target.records)
    return replace(target, records=tuple(records))


@dataclass(frozen=True)
class Simulated:
    """A specimen's true parameters by name, each (1,), and its simulated records."""

    truth: Mapping[str, FloatArray]
    records: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...]


def simulate(
    world: World,
    target: LogPosterior,
    rng: np.random.Generator,
    with_error: bool = False,
) -> Simulated:
    """Draw a specimen from the target's prior and simulate all records of the world with it.

    A record held out has the noise parameters of its protocol's, or of the first record.

    Parameters
    ----------
    with_error : whether the fitted records also have a smooth error that no candidate has.
    """
    while True:
        truth = target.draws(target.prior.sample(rng, 1))
        noisy = [
            responded(target, truth, noise_of(target, truth, r), r, rng)
            for r in (*world.records, *world.held_out)
        ]
        if all(np.isfinite(record.response).all() for record in noisy):
            break
    count = len(world.records)
    records = noisy[:count]
    if with_error:
        records = [
            replace(e, response=e.response + smooth_error(rng, world.smooth_in, e)) for e in records
        ]
    return Simulated(truth, tuple(records), tuple(noisy[count:]))


def noise_of(
    target: LogPosterior, truth: Mapping[str, FloatArray], experiment: Experiment
) -> Mapping[str, FloatArray]:
    """The noise parameters of one specimen's record, whose range is that of its clean response."""
    like = record_of(target, experiment)
    if like.correlated_scale != 1.0:
        clean = target.system.simulator_of(experiment)(truth)
        like = replace(like, correlated_scale=float(np.ptp(clean)))
    return target.noise_draws(truth, like)


def record_of(target: LogPosterior, experiment: Experiment) -> Record:
    """The record whose noise an experiment has: its own, one of its protocol, or the first."""
    alike = [r for r in target.records if r.experiment.protocol == experiment.protocol]
    own = [r for r in alike if r.experiment.name == experiment.name]
    return next(iter((*own, *alike, *target.records)))


def responded(
    target: LogPosterior,
    truth: Mapping[str, FloatArray],
    noise: Mapping[str, FloatArray],
    experiment: Experiment,
    rng: np.random.Generator,
) -> Experiment:
    """An experiment with the noisy response of one specimen; NaN where the specimen fails."""
    clean = target.system.simulator_of(experiment)(truth)
    weights = 1.0 / experiment.samples_averaged
    correlated, white = target.noise.sample(rng, experiment.coordinate, weights, noise)
    scale = ResidualScale(1.0, experiment.response_name in target.system.proportional)
    return replace(experiment, response=scale.with_residuals(clean, correlated + white)[0])


def log_time(experiment: Experiment) -> FloatArray:
    """Coordinate of an error with about a feature per factor e of time.

    A spectrum of relaxation times leaves such an error of a model with few.
    """
    return np.log(experiment.coordinate)


def fifths(experiment: Experiment) -> FloatArray:
    """Coordinate of an error with about five features along the record."""
    return experiment.coordinate / (0.2 * np.ptp(experiment.coordinate))


def error_covariance(
    smooth_in: SmoothIn, experiment: Experiment, share: float = ERROR_SHARE
) -> FloatArray:
    """Covariance (N, N) of a smooth error of a model, `share` of the record's range.

    It is squared-exponential, of length 1 in the coordinate that `smooth_in` gives.
    """
    along = smooth_in(experiment)
    covariance = np.exp(-0.5 * np.subtract.outer(along, along) ** 2) + 1e-8 * np.eye(along.size)
    return (share * experiment.response_range) ** 2 * covariance


def smooth_error(
    rng: np.random.Generator, smooth_in: SmoothIn, experiment: Experiment
) -> FloatArray:
    """Sample of a smooth error of a model over a record, (N,)."""
    covariance = error_covariance(smooth_in, experiment)
    return np.linalg.cholesky(covariance) @ rng.standard_normal(len(covariance))


def blank(
    name: str,
    protocol: str,
    response: tuple[str, str],
    time: FloatArray,
    excitation: Excitation,
    role: Role = "calibrate",
    coordinate: tuple[str, str] = ("time", "s"),
) -> Experiment:
    """An experiment whose response, here a ramp, is still to be simulated."""
    return Experiment(
        name, protocol, role, *coordinate, time, *response,
        np.linspace(0.5, 1.0, time.size), np.ones(time.size), excitation, provenance="simulated",
    )  # fmt: skip
