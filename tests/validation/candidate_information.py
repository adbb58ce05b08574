"""Estimators of what an experiment tells about the candidate, against exact answers.

Pairs of candidates of `DIMENSIONS` parameters whose curves are polynomials in time (linear in the
parameters), or relaxations exp(-t/tau) (not linear). Exact: densities in closed form, or the mean
over 20 000 draws. Estimators use 500 draws for the density and 250 for samples, as the pipeline:
the draws' mean density alone, the normal ones alone, and both by halves (`Predictive`).
Written: candidate_information.csv, one row per pair, means over `REPEATS` posteriors.

    python -m tests.validation.candidate_information
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from deabayes.comparison.further import candidate_information
from deabayes.experiment import FloatArray
from deabayes.noise.white import White
from deabayes.prediction.outcomes import Predictive, Reading
from tests.validation import rows

FILE = "candidate_information.csv"
SEED, REPEATS = 20261122, 10
KNOWN, OTHERS, MANY = 500, 250, 20_000
TIME = np.linspace(0.02, 1.0, 60)
NOISE = 0.1
DIMENSIONS = (2, 6, 12)
Curves = Callable[[np.random.Generator, int], FloatArray]


class DrawsOnly(Predictive):
    """The mean of p(y | theta_s) over draws."""

    def log_density(self, y: tuple[FloatArray, ...]) -> FloatArray:
        log_densities = [self.known[0].log_density(row) for row in y[0]]
        return np.asarray(logsumexp(log_densities, axis=1) - np.log(KNOWN))


class NormalOnly(Predictive):
    """The normal densities alone."""

    def log_density(self, y: tuple[FloatArray, ...]) -> FloatArray:
        return self.normals[0].log_density(self.known, y)


ESTIMATORS = {"draws": DrawsOnly, "normal": NormalOnly, "halves": Predictive}


def polynomials(terms: int, sd: float, shift: float) -> tuple[Curves, FloatArray, FloatArray]:
    """Curves sum_k theta_k P_k(t), theta ~ N(0, sd^2), and a last coefficient about `shift`."""
    design = np.polynomial.legendre.legvander(2.0 * TIME - 1.0, terms - 1).T
    mean = shift * design[-1]

    def curves(rng: np.random.Generator, size: int) -> FloatArray:
        return mean + sd * rng.standard_normal((size, terms)) @ design

    return curves, mean, sd**2 * design.T @ design + NOISE**2 * np.eye(TIME.size)


def relaxations(units: int, spread: float) -> Curves:
    """1 + sum_k exp(-t / tau_k), each of the same weight, tau log-normal about places in [0, 1]."""
    places = np.geomspace(0.05, 0.5, units) if units > 1 else np.array([0.15])

    def curves(rng: np.random.Generator, size: int) -> FloatArray:
        times = places * np.exp(spread * rng.standard_normal((size, units)))
        return 1.0 + np.exp(-TIME / times[:, :, None]).mean(axis=1)

    return curves


def reading(curves: FloatArray) -> Reading:
    size = len(curves)
    draws = {"sigma_white": np.full(size, NOISE)}
    return Reading(curves, np.ones(size), White(), draws, TIME, np.ones(TIME.size))


def estimated(pair: list[Curves], kind: type[Predictive], seed: int) -> tuple[float, float]:
    """Return the information in nats and its stated error, by one estimator."""
    rng = np.random.default_rng([SEED, seed])
    made = [kind((reading(c(rng, KNOWN)),), (reading(c(rng, OTHERS)),)) for c in pair]
    information = candidate_information(made, rng)
    return information.nats, information.nats_error


def exact_of(densities: list[Callable[[FloatArray], FloatArray]], y: list[FloatArray]) -> float:
    """log 2 + E[log q(M | y)] with the true densities."""
    terms = []
    for truth, outcomes in enumerate(y):
        log_p = np.stack([density(outcomes) for density in densities])
        terms.append(np.mean(log_p[truth] - np.logaddexp(*log_p)))
    return float(np.log(2.0) + np.mean(terms))


def linear_pairs() -> Iterator[tuple[str, list[Curves], float]]:
    rng = np.random.default_rng(SEED)
    for terms in DIMENSIONS:
        for sd, shift in ((0.03, 0.03), (0.3, 0.3), (3.0, 3.0)):
            models = [polynomials(terms, sd, 0.0), polynomials(terms, sd, 2.0 * shift)]
            laws = [multivariate_normal(mean, covariance) for _, mean, covariance in models]
            y = [law.rvs(50_000, rng) for law in laws]
            exact = exact_of([law.logpdf for law in laws], y)
            told = 0.5 * np.linalg.slogdet(models[0][2] / NOISE**2)[1]
            yield f"linear, {terms} parameters, {told:.0f} nats", [m[0] for m in models], exact


def relaxation_pairs() -> Iterator[tuple[str, list[Curves], float]]:
    rng = np.random.default_rng(SEED)
    for spread in (0.1, 0.3, 1.0):
        pair = [relaxations(1, spread), relaxations(2, spread)]
        wide = [reading(curves(rng, MANY)) for curves in pair]
        densities = [
            lambda y, r=draws: np.array([logsumexp(r.log_density(row)) for row in y])
            for draws in wide
        ]
        y = [reading(curves(rng, 1000)).sample(rng) for curves in pair]
        yield f"relaxations, spread {spread}", pair, exact_of(densities, y)


def row_of(pair: str, curves: list[Curves], exact: float) -> rows.Row:
    """Return mean, scatter and mean stated error of every estimator over `REPEATS` posteriors."""
    row: rows.Row = {"pair": pair, "exact_nats": f"{exact:.3f}"}
    for label, kind in ESTIMATORS.items():
        estimates = np.array([estimated(curves, kind, k) for k in range(REPEATS)])
        row[f"{label}_nats"] = f"{estimates[:, 0].mean():.3f}"
        row[f"{label}_scatter"] = f"{estimates[:, 0].std(ddof=1):.3f}"
        row[f"{label}_stated_error"] = f"{estimates[:, 1].mean():.3f}"
    return row


def main() -> None:
    path = rows.parser(__doc__).parse_args().output / FILE
    for pair, curves, exact in (*linear_pairs(), *relaxation_pairs()):
        rows.write(path, {**row_of(pair, curves, exact), **rows.provenance(SEED)})


if __name__ == "__main__":
    main()
