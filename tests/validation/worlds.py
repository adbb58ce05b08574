"""Simulated specimens: what is known of them beforehand, their records, and their noise.

A world is a family of models with the priors of somebody who has an idea of the material,
and blank records that a specimen drawn from those priors is put through. The worlds of each
system are in `membrane_worlds`, `tubular_worlds` and `structure_worlds`.

The noise is drawn from the noise priors at the scale of the records of the prior's median
specimen, one set of noise parameters for all records of a protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Role, Specimen
from deabayes.inference.log_posterior import LogPosterior, build
from deabayes.inference.record_noise import ResidualScale
from deabayes.study import Settings, Study

Discrepancy = Callable[[np.random.Generator, Experiment], FloatArray]
NoiseGroups = Literal["protocol", "experiment"]
OU = "ornstein_uhlenbeck"


@dataclass(frozen=True)
class World:
    """Models `{family}_{n}{ending}` of a specimen, and blank records of it.

    Attributes
    ----------
    priors : from the number of units to the priors of a model with as many.
    records, held_out : experiments whose response is still to be simulated.
    """

    family: str
    specimen: Specimen
    priors: Callable[[int], Mapping[str, Settings]]
    records: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...] = ()
    noise_groups: NoiseGroups = "protocol"
    ending: str = ""

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
    discrepancy: Discrepancy | None = None,
) -> Simulated:
    """Draw a specimen from the target's prior and simulate all records of the world with it.

    A record held out has the noise parameters of its protocol's, or of the first record.

    Parameters
    ----------
    discrepancy : what the model leaves out of a record, added to it (N,); the records held
        out are without.
    """
    while True:
        truth = target.draws(target.prior.sample(rng, 1))
        noisy = [
            responded(target, truth, target.noise_draws(truth, group_of(target, r)), r, rng)
            for r in (*world.records, *world.held_out)
        ]
        if all(np.isfinite(record.response).all() for record in noisy):
            break
    count = len(world.records)
    records = noisy[:count]
    if discrepancy is not None:
        records = [replace(e, response=e.response + discrepancy(rng, e)) for e in records]
    return Simulated(truth, tuple(records), tuple(noisy[count:]))


def group_of(target: LogPosterior, experiment: Experiment) -> str:
    """The noise group of a record: its own, that of its protocol, or the first."""
    groups = {record.experiment.protocol: record.group for record in reversed(target.records)}
    groups |= {record.experiment.name: record.group for record in target.records}
    first = target.records[0].group
    return groups.get(experiment.name, groups.get(experiment.protocol, first))


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


def smooth_in_log_time(
    rng: np.random.Generator, experiment: Experiment, share: float = 0.01
) -> FloatArray:
    """A smooth error of a model, `share` of the record's range, even in the logarithm of time.

    A Gaussian process with a squared-exponential covariance of length 1 in ln t: about a
    feature per factor e of time, as a spectrum of relaxation times leaves it.
    """
    log_time = np.log(experiment.coordinate)
    covariance = np.exp(-0.5 * np.subtract.outer(log_time, log_time) ** 2)
    root = np.linalg.cholesky(covariance + 1e-8 * np.eye(log_time.size))
    return share * experiment.response_range * (root @ rng.standard_normal(log_time.size))


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
