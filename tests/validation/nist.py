r"""NIST's nonlinear regression sets through the project's log-posterior and sampler.

Every set is a system with one forward model, white noise of unknown sd and flat priors, and is
sampled as a study does by default. Its posterior has a known relation to
least squares. With p(b) flat, p(sigma) = 1/sigma and S(b) the sum of squares of n residuals,

    p(b | y) = int sigma^-(n+1) exp(-S(b) / 2 sigma^2) dsigma  ~  S(b)^(-n/2).

Where the response is linear, S(b) = S_min + (b - b_min)' J'J (b - b_min), and this is a
Student-t with nu = n - p degrees of freedom about b_min, of scale matrix s^2 (J'J)^-1 with
s^2 = S_min / nu: NIST's certified estimates and sds. So the mean must be the certified
estimate, the sd the certified one times sqrt(nu / (nu - 2)). Where the response bends, the
posterior differs from that for good reason: what it must be is then computed from S(b)^(-n/2) by
importance sampling (`nist_reference`), without the log-posterior, priors and sampler tested here.

Priors. Each b is uniform within three times NIST's second starting value about that value, b0
- 3 |b0| to b0 + 3 |b0|; certified estimates play no part. Where the response is even in a parameter
(a width) the lower end is 0; for ENSO's periods it is two months, below which they are aliases.
Parameters that only number exchangeable terms ascend, under a common prior. `edge` is the
share of draws in the outer hundredth of a prior: 0 unless it cuts the posterior.
sigma: log-uniform from 1e-15 to 10 times the range of the response.

    python -m tests.validation.nist --sets Misra1a Thurber

Rows are appended as sets finish (one per parameter), so a stopped run goes on where it was.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Specimen
from deabayes.inference.log_posterior import LogPosterior, Record
from deabayes.inference.record_noise import noise_group, noise_parameters, record_scale
from deabayes.noise.white import White
from deabayes.prior.distributions import Uniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter
from deabayes.study import Study
from deabayes.systems.base import Draws, Simulator, System
from tests.validation import rows
from tests.validation.nist_models import CURVES
from tests.validation.nist_sets import CertifiedSet, certified, tasks_of
from tests.validation.sampled import Sampled, sample

FILE = "nist.csv"
SEED = 20261122
SIGMA_RANGE = 1e-15, 10.0
"""Bounds of the prior of the noise's sd, in ranges of the response."""


class Regression(System):
    """A curve y = f(x; b) with flat priors on b."""

    name: ClassVar = "regression"
    protocols: ClassVar = ("regression",)
    excitations: ClassVar = {"x": "1"}
    responses: ClassVar = {"y": "1"}
    required_quantities: ClassVar = {}

    def __init__(self, candidate: str, specimen: Specimen) -> None:
        self.candidate, self.specimen, self.order = candidate, specimen, 1
        self.set = certified(candidate)

    @classmethod
    def candidates(cls) -> Sequence[str]:
        return tuple(CURVES)

    def parameters(self) -> tuple[Parameter, ...]:
        """Exchangeable ones in ascending order, which is not always that of their numbers."""
        curve = self.set.curve
        bounds = dict(zip(self.set.names, self.set.bounds.tolist(), strict=True))
        others = [name for name in self.set.names if name not in curve.ordered]
        return tuple(
            Parameter(
                name, name, "1", f"{name} of {self.candidate}",
                Uniform(*bounds[name]),
                "about NIST's second starting value",
                ordered="exchangeable" if name in curve.ordered else None,
                belongs_to=curve.belonging.get(name),
            )
            for name in (*curve.ordered, *others)
        )  # fmt: skip

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        self.check_channels(excitation.name, response)

        def simulate(draws: Draws) -> FloatArray:
            b = (draws[name][:, None] for name in self.set.names)
            with np.errstate(all="ignore"):
                return self.set.curve.model(coordinate, *b)

        return simulate


def target(name: str) -> LogPosterior:
    """The log-posterior of a set: flat in b and in log sigma, white noise."""
    nist_set = certified(name)
    spread = float(np.ptp(nist_set.y))
    lower, upper = (factor * spread for factor in SIGMA_RANGE)
    prior = {"distribution": "loguniform", "lower": lower, "upper": upper}
    study = Study("nist", Path(), (name,), noise="white", priors={"sigma_white": prior})
    system = Regression(name, Specimen(name, "regression", {"kind": "measured"}, {}))
    experiment = Experiment(
        name, "regression", "calibrate", "x", "1", nist_set.x, "y", "1", nist_set.y,
        np.ones(nist_set.y.size), Excitation("x", "1", nist_set.x, nist_set.x),
    )  # fmt: skip
    simulate = system.simulator(experiment.excitation, experiment.coordinate, "y")
    scale = record_scale(study, system, experiment)
    record = Record(experiment, simulate, noise_group(study, experiment), scale, nist_set.x)
    noise = White()
    of_noise = noise_parameters(study, noise, [experiment], system)
    parameters = (*system.parameters(), *of_noise)
    return LogPosterior(
        system, (record,), noise, Prior.from_parameters(parameters, study.priors, ())
    )


def compared(sampled: Sampled, nist_set: CertifiedSet) -> list[rows.Row]:
    """One row per parameter: the posterior against what is certified.

    Differences are in certified sds; `mcse_sd` is the standard error of the mean, in posterior
    sds (that of the sd, relative, is 0.7 times it for a normal posterior, more for a long tail).
    """
    draws = dict(zip(sampled.target.names, sampled.theta.T, strict=True))
    expected = nist_set.freedom / (nist_set.freedom - 2.0)
    table, result = sampled.result.convergence.table, []
    for k, name in enumerate(nist_set.names):
        mean, sd = float(draws[name].mean()), float(draws[name].std())
        estimate, certified_sd = float(nist_set.estimates[k]), float(nist_set.sds[k])
        error = float(table.loc[name, "mcse_mean"] / table.loc[name, "sd"])
        row: rows.Row = {"set": nist_set.name, "parameter": name, "certified": f"{estimate:.10e}"}
        row |= {"certified_sd": f"{certified_sd:.10e}", "mean": f"{mean:.10e}", "sd": f"{sd:.6e}"}
        row |= {"difference_sd": f"{(mean - estimate) / certified_sd:.4f}"}
        row |= {"sd_ratio": f"{sd / certified_sd:.4f}", "expected_sd_ratio": f"{expected**0.5:.4f}"}
        row |= {"mcse_sd": f"{error:.4f}", "edge": f"{edge(draws[name], *nist_set.bounds[k]):.5f}"}
        result.append({**row, **sampled.row()})
    return result


def edge(draws: FloatArray, lower: float, upper: float) -> float:
    """The share of draws in the outer hundredth of a prior, at both ends together."""
    place = (draws - lower) / (upper - lower)
    return float(np.mean((place < 0.005) | (place > 0.995)))


def run(task: rows.Task) -> list[rows.Row]:
    """Sample one set, and compare."""
    name = str(task["set"])
    seed = np.random.SeedSequence([SEED, zlib.crc32(name.encode())])
    return compared(sample(target(name), seed), certified(name))


def main() -> None:
    parser = rows.parser(__doc__)
    parser.add_argument("--sets", nargs="*", choices=list(CURVES), default=list(CURVES))
    options = parser.parse_args()
    rows.append(options.output / FILE, tasks_of(options.sets), run, SEED, options.processes)


if __name__ == "__main__":
    main()
