"""The means and sds that the posteriors S(b)^(-n/2) of `nist` have, by importance sampling.

The proposal is a mixture of Student-t, fitted in rounds to the weighted draws of the round
before; it starts from the linearised problem, in whose principal coordinates all is done.
Nothing of `deabayes` takes part.

    python -m tests.validation.nist_reference
"""

from __future__ import annotations

import argparse
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.validation import rows
from tests.validation.nist_models import CURVES
from tests.validation.nist_sets import CertifiedSet, certified

FloatArray = NDArray[np.float64]
OUTPUT = Path("docs/validation")
FILE = "nist_reference.csv"
SEED = 20261123
ROUNDS, PER_ROUND, FITTED_TO, FINAL, BATCH = 12, 20000, 4000, 400000, 20000
COMPONENTS, FREEDOM = 16, 5.0
INFLATED = 1.3
"""Covariances of the proposal's components over the fitted ones."""


@dataclass(frozen=True)
class Mixture:
    """Student-t of 5 degrees of freedom: shares (K,), centres (K, p), factors (K, p, p)."""

    shares: FloatArray
    centres: FloatArray
    factors: FloatArray

    def sample(self, size: int, rng: np.random.Generator) -> FloatArray:
        chosen = rng.choice(self.shares.size, size, p=self.shares)
        normal = rng.standard_normal((size, self.centres.shape[1]))
        stretched = normal / np.sqrt(rng.chisquare(FREEDOM, (size, 1)) / FREEDOM)
        return self.centres[chosen] + np.einsum("sij,sj->si", self.factors[chosen], stretched)

    def log_density(self, u: FloatArray) -> FloatArray:
        """Without the constant that all components share."""
        from scipy.linalg import solve_triangular
        from scipy.special import logsumexp

        terms = []
        for share, centre, factor in zip(self.shares, self.centres, self.factors, strict=True):
            squares = np.sum(solve_triangular(factor, (u - centre).T, lower=True) ** 2, axis=0)
            height = np.log(share) - np.log(np.diag(factor)).sum()
            terms.append(height - 0.5 * (FREEDOM + u.shape[1]) * np.log1p(squares / FREEDOM))
        return np.asarray(logsumexp(np.stack(terms), axis=0))


def reference(found: CertifiedSet, rng: np.random.Generator) -> list[rows.Row]:
    """Mean and sd of every parameter, in certified sds from the certified estimate."""
    size = len(found.names)
    proposal = Mixture(np.ones(1), np.zeros((1, size)), np.eye(size)[None])
    for _ in range(ROUNDS):
        u, log_weights = weighted(found, proposal, PER_ROUND, rng)
        proposal = fitted(u, tempered(log_weights), rng)
    parts = [weighted(found, proposal, BATCH, rng) for _ in range(FINAL // BATCH)]
    u, log_weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    shifts = (found.least_squares - found.estimates + u @ found.factor.T) / found.sds
    means = weights @ shifts
    sds = np.sqrt(weights @ (shifts - means) ** 2)
    effective = 1.0 / np.sum(weights**2)
    return [
        {
            "set": found.name, "parameter": name, "difference_sd": f"{mean:.4f}",
            "sd_ratio": f"{sd:.4f}", "effective_draws": f"{effective:.0f}",
        }
        for name, mean, sd in zip(found.names, means, sds, strict=True)
    ]  # fmt: skip


def weighted(
    found: CertifiedSet, proposal: Mixture, size: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws u (size, p) of the proposal, and the log of target over proposal (size,)."""
    u = proposal.sample(size, rng)
    b = found.least_squares + u @ found.factor.T
    inside = np.all((b > found.bounds[:, 0]) & (b < found.bounds[:, 1]), axis=1)
    exchangeable = b[:, [found.names.index(name) for name in found.curve.ordered]]
    inside &= np.all(np.diff(exchangeable, axis=1) > 0.0, axis=1)
    with np.errstate(all="ignore"):
        log_target = -0.5 * found.y.size * np.log(found.squares(b) / found.sum_of_squares)
    log_weights = log_target - proposal.log_density(u)
    return u, np.where(inside & np.isfinite(log_weights), log_weights, -np.inf)


def fitted(u: FloatArray, weights: FloatArray, rng: np.random.Generator) -> Mixture:
    """A mixture fitted to weighted draws."""
    from sklearn.mixture import GaussianMixture

    chosen = u[rng.choice(len(u), FITTED_TO, p=weights)]
    scale = chosen.std(axis=0)
    seed = int(rng.integers(2**31))
    normal = GaussianMixture(COMPONENTS, reg_covar=1e-4, random_state=seed).fit(chosen / scale)
    factors = scale[:, None] * np.linalg.cholesky(INFLATED * normal.covariances_)
    return Mixture(normal.weights_ / normal.weights_.sum(), scale * normal.means_, factors)


def tempered(log_weights: FloatArray) -> FloatArray:
    """Weights raised to the largest power up to 1 that leaves 5 % of the draws effective."""
    relative = log_weights - log_weights.max()
    power = 1.0
    while True:
        weights = np.exp(power * relative)
        if weights.sum() ** 2 / np.sum(weights**2) >= 0.05 * weights.size or power < 1e-3:
            return np.asarray(weights / weights.sum())
        power *= 0.8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", nargs="*", choices=list(CURVES), default=list(CURVES))
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    path = options.output / FILE
    last: list[rows.Task] = [{"set": n, "parameter": certified(n).names[-1]} for n in options.sets]
    for task in rows.missing(path, last):
        name = str(task["set"])
        rng = np.random.default_rng([SEED, zlib.crc32(name.encode())])
        found = reference(certified(name), rng)
        for row in found:
            rows.write(path, {**row, **rows.provenance(SEED)})
        print(f"nist_reference {name}: {found[0]['effective_draws']} effective draws", flush=True)


if __name__ == "__main__":
    main()
