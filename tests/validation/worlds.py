"""Simulated specimens: what is known of them beforehand, their records, and their noise.

A world is a family of models with the priors of somebody who has an idea of the material,
and blank records that a specimen drawn from those priors is put through.

The membrane's priors are the default ones narrowed about the parameters of Nguyen et al.
(2021), so that over nine in ten draws stay on the near branch at 4 kV. A draw that is
pulled in is drawn again: the posterior excludes it too (its likelihood is zero), so ranks
stay uniform. Records are those of the joint fit in mixing.md: steps to 2, 3 and 4 kV with
155 points each on a grid whose spacing doubles from 0.25 to 8 s, to 595 s. Held out are a
step to 3.5 kV and five periods of a sine of 2 kV at 0.05 Hz.

The tubular actuator's whole model (mass and circuit) has a creep record and frequency
responses under 100 and 500 g, gain and phase each; held out are creep at 2.5 kV and the
response under 300 g.

The noise is drawn from the noise priors at the scale of the records of the prior's median
specimen, one set of noise parameters for all records of a protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Quantity, Role, Specimen
from deabayes.posterior import LogPosterior, build
from deabayes.residual_scale import ResidualScale
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
            responded(target, truth, target.noise_draws(truth, group_of(target, each)), each, rng)
            for each in (*world.records, *world.held_out)
        ]
        if all(np.isfinite(each.response).all() for each in noisy):
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
    clean = target.system.predict(
        experiment.excitation, experiment.coordinate, experiment.response_name, truth
    )
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


def doubling_grid(points: int = 20, last: int = 55, refined: int = 1) -> FloatArray:
    """Times whose spacing doubles from 0.25 to 8 s: 155 points to 595 s, or `refined` as many."""
    counts = [points] * 5 + [last]
    spacing = np.concatenate([np.full(n, 0.25 * 2**k) for k, n in enumerate(counts)])
    return np.cumsum(np.repeat(spacing / refined, refined))


def membrane(refined: int = 1) -> World:
    """The membrane; `refined` sets how many times denser than 155 points its records are."""
    quantities = {
        "side_length": Quantity(0.01, "m"),
        "thickness": Quantity(1e-3, "m"),
        "permittivity": Quantity(4.11e-11, "F/m", 0.9e-12),
        "prestretch": Quantity(3.0, "1"),
    }
    grid, displacement = doubling_grid(refined=refined), ("displacement", "m")

    def step(kilovolts: float, role: Role = "calibrate") -> Experiment:
        volts = np.full(2, 1e3 * kilovolts)
        excitation = Excitation("voltage", "V", np.array([0.0, 600.0]), volts)
        return blank(f"step_{kilovolts:g}kV", "step", displacement, grid, excitation, role)

    knots = np.linspace(0.0, 100.0, 2001)
    alternating = Excitation("voltage", "V", knots, 2e3 * np.sin(0.1 * np.pi * knots))
    sine = blank("sine_2kV", "sine", displacement, knots[10::10], alternating, "validate")
    return World(
        "kv_gm",
        Specimen("validation", "membrane", {"kind": "simulated"}, quantities),
        membrane_priors,
        (step(2.0), step(3.0), step(4.0)),
        (step(3.5, "validate"), sine),
    )


def membrane_priors(units: int) -> dict[str, Settings]:
    """The default priors, narrowed about Nguyen et al. (2021)."""
    return {
        "mu_alpha": {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.3},
        "zeta_alpha": {"distribution": "lognormal", "median": "100 kPa s", "sigma": 0.7},
        "J_alpha": {"distribution": "lognormal", "median": 110.0, "sigma": 0.4},
        "J_beta": {"distribution": "lognormal", "median": 55.0, "sigma": 0.4},
        "tau_beta": {"distribution": "loguniform", "lower": "2 s", "upper": "400 s"},
        **{
            f"mu_beta_{i}": {"distribution": "lognormal", "median": "15 kPa", "sigma": 0.6}
            for i in range(1, units + 1)
        },
    }


def tubular() -> World:
    """A creep record of 0.5 s at 2 kV, as in `calibration`: the cheap family."""
    quantities = {
        "thickness": Quantity(80e-6, "m", 2e-6),
        "relative_permittivity": Quantity(3.1, "1", 0.1),
        "active_length": Quantity(0.07, "m"),
    }
    excitation = Excitation("voltage", "V", np.array([0.0, 1e-9, 0.5]), np.array([0, 2e3, 2e3]))
    time = np.geomspace(1e-3, 0.5, 120)
    return World(
        "voigt_kelvin",
        Specimen("validation", "tubular", {"kind": "simulated"}, quantities),
        tubular_priors,
        (blank("creep", "creep", ("strain", "1"), time, excitation),),
    )


def tubular_priors(units: int) -> dict[str, Settings]:
    """What one knows of a silicone before the test."""
    return {
        "E_0": {"distribution": "lognormal", "median": "1.5 MPa", "sigma": 0.3},
        "tau": {"distribution": "loguniform", "lower": "2 ms", "upper": "1 s"},
        **{
            f"E_{i}": {"distribution": "lognormal", "median": "10 MPa", "sigma": 0.5}
            for i in range(1, units + 1)
        },
    }


def tubular_full() -> World:
    """The whole tubular actuator: creep and frequency responses under two loads."""
    quantities = {
        "thickness": Quantity(80e-6, "m", 2e-6),
        "relative_permittivity": Quantity(3.1, "1", 0.1),
        "active_length": Quantity(0.07, "m"),
        "cross_section": Quantity(6e-4, "m^2", 0.15e-4),
        "total_mass": Quantity(0.1005, "kg"),
        "active_mass": Quantity(0.0462, "kg", 1e-3),
        "sensor_mass": Quantity(0.01, "kg", 5e-4),
        "series_resistance": Quantity(954.0, "ohm", 50.0),
        "leakage_resistance": Quantity(1e9, "ohm", 0.2e9),
        "capacitance": Quantity(180e-9, "F", 2e-9),
    }
    time, frequency = np.arange(2e-3, 0.5, 2e-3), np.arange(1.0, 100.5, 1.0)

    def creep(kilovolts: float, role: Role = "calibrate") -> Experiment:
        """Raised within 3 ms, as a current of 120 mA does it."""
        volts = 1e3 * kilovolts * np.array([0.0, 1.0, 1.0])
        excitation = Excitation("voltage", "V", np.array([0.0, 3e-3, 0.5]), volts)
        return blank(f"creep_{kilovolts:g}kV", "creep", ("strain", "1"), time, excitation, role)

    def shaken(load: float, role: Role = "calibrate") -> tuple[Experiment, Experiment]:
        held = {"load_g": load, "bias_kV": 2.0}
        excitation = Excitation("frequency", "Hz", frequency, frequency, held)
        name, protocol, along = f"shaken_{load:g}g", "frequency_response", ("frequency", "Hz")
        return (
            blank(name, protocol, ("gain", "1/V"), frequency, excitation, role, along),
            blank(f"{name}_phase", protocol, ("phase", "rad"), frequency, excitation, role, along),
        )

    return World(
        "voigt_kelvin",
        Specimen("validation", "tubular", {"kind": "simulated"}, quantities),
        tubular_priors,
        (creep(2.0), *shaken(100.0), *shaken(500.0)),
        (creep(2.5, "validate"), *shaken(300.0, "validate")),
        ending="_inertia_circuit",
    )
