r"""The means and sds that the posteriors S(b)^(-n/2) of `nist` have, by importance sampling.

The proposal is a mixture of Student-t and the prior, fitted in rounds to the weighted draws of
the round before; it starts from the linearised problem. Parameters a in which the response is
linear, y = A(c) a + noise, are integrated out where the set says so (`Curve.linear`): the
posterior of the others is

    S_min(c)^(-(n - m)/2) |A'A|^(-1/2),

and a given c, from which it is drawn, a Student-t of n - m degrees of freedom about its
least-squares estimate, m being their number. Nothing of `deabayes` takes part.

    python -m tests.validation.nist_reference
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.validation import rows
from tests.validation.nist_models import CURVES
from tests.validation.nist_sets import CertifiedSet, certified, tasks_of

FloatArray = NDArray[np.float64]
FILE = "nist_reference.csv"
SEED = 20261123
ROUNDS, PER_ROUND, FITTED_TO, FINAL, BATCH = 12, 10000, 4000, 100000, 10000
COMPONENTS, FREEDOM = 16, 5.0
PRIOR_SHARE = 0.1
"""Share of the prior in the proposal, so that no mode is missed."""
INFLATED = 1.3
"""Factor on the fitted covariances of the proposal's components."""


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
        from scipy.linalg import solve_triangular
        from scipy.special import gammaln, logsumexp

        terms = []
        for share, centre, factor in zip(self.shares, self.centres, self.factors, strict=True):
            squares = np.sum(solve_triangular(factor, (u - centre).T, lower=True) ** 2, axis=0)
            height = np.log(share) - np.log(np.diag(factor)).sum()
            terms.append(height - 0.5 * (FREEDOM + u.shape[1]) * np.log1p(squares / FREEDOM))
        half, size = 0.5 * FREEDOM, u.shape[1]
        constant = gammaln(half + 0.5 * size) - gammaln(half) - 0.5 * size * np.log(FREEDOM * np.pi)
        return np.asarray(logsumexp(np.stack(terms), axis=0) + constant)


@dataclass(frozen=True)
class Collapsed:
    """The posterior of a set's parameters c = centre + factor u, the linear ones integrated out."""

    nist_set: CertifiedSet

    @property
    def kept(self) -> list[int]:
        """Columns of c among b."""
        linear = self.nist_set.curve.linear
        return [k for k, name in enumerate(self.nist_set.names) if name not in linear]

    @property
    def integrated(self) -> list[int]:
        """Columns of a among b."""
        return [k for k in range(len(self.nist_set.names)) if k not in self.kept]

    @property
    def factor(self) -> FloatArray:
        return np.asarray(np.linalg.qr(self.nist_set.factor[self.kept].T, mode="r").T)

    @property
    def bounds(self) -> FloatArray:
        return self.nist_set.bounds[self.kept]

    def parameters(self, u: FloatArray) -> FloatArray:
        return self.nist_set.least_squares[self.kept] + u @ self.factor.T

    def drawn(self, u: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """All b (W, p) given u (W, q), and the log density of u (W,)."""
        nist_set, linear = self.nist_set, self.integrated
        b = np.zeros((len(u), len(nist_set.names)))
        b[:, self.kept] = self.parameters(u)
        if not linear:
            return b, -0.5 * nist_set.y.size * np.log(nist_set.squares(b))
        unit = [b + np.eye(len(nist_set.names))[k] for k in linear]
        design = np.stack([nist_set.response(each) for each in unit], axis=2)
        valid = np.isfinite(design).all(axis=(1, 2))
        q, r = np.linalg.qr(np.where(valid[:, None, None], design, np.eye(*design.shape[1:])))
        projected = np.einsum("wnm,n->wm", q, nist_set.y)
        squares = np.sum((nist_set.y - np.einsum("wnm,wm->wn", q, projected)) ** 2, axis=1)
        freedom = nist_set.y.size - len(linear)
        diagonal = np.abs(np.diagonal(r, axis1=1, axis2=2))
        log_density = -0.5 * freedom * np.log(squares) - np.log(diagonal).sum(axis=1)
        spread = np.sqrt(squares / rng.chisquare(freedom, len(u)))[:, None]
        projected += spread * rng.standard_normal(projected.shape)
        b[:, linear] = np.einsum("wij,wj->wi", np.linalg.pinv(r), projected)
        return b, np.where(valid, log_density, -np.inf)


def run(task: rows.Task) -> list[rows.Row]:
    """Weigh up one set."""
    name = str(task["set"])
    rng = np.random.default_rng([SEED, zlib.crc32(name.encode())])
    return reference(certified(name), rng)


def reference(nist_set: CertifiedSet, rng: np.random.Generator) -> list[rows.Row]:
    """Mean and sd of every parameter, in certified sds from the certified estimate."""
    target = Collapsed(nist_set)
    size = len(target.kept)
    proposal = Mixture(np.ones(1), np.zeros((1, size)), np.eye(size)[None])
    for _ in range(ROUNDS):
        u, log_weights, _ = weighted(target, proposal, PER_ROUND, rng)
        proposal = fitted(u, tempered(log_weights), rng)
    parts = [weighted(target, proposal, BATCH, rng)[1:] for _ in range(FINAL // BATCH)]
    log_weights, b = (np.concatenate(each) for each in zip(*parts, strict=True))
    weights = np.exp(log_weights - log_weights.max())
    used = weights > 0.0
    weights = weights[used] / weights.sum()
    shifts = (b[used] - nist_set.estimates) / nist_set.sds
    means = weights @ shifts
    sds = np.sqrt(weights @ (shifts - means) ** 2)
    effective = 1.0 / np.sum(weights**2)
    return [
        {
            "set": nist_set.name, "parameter": name, "difference_sd": f"{mean:.4f}",
            "sd_ratio": f"{sd:.4f}", "effective_draws": f"{effective:.0f}",
        }
        for name, mean, sd in zip(nist_set.names, means, sds, strict=True)
    ]  # fmt: skip


def weighted(
    target: Collapsed, proposal: Mixture, size: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draws u (size, q), the log of target over proposal (size,), and b (size, p)."""
    bounds, names = target.bounds, target.nist_set.names
    u = proposal.sample(size, rng)
    from_prior = rng.random(size) < PRIOR_SHARE
    anywhere = rng.uniform(bounds[:, 0], bounds[:, 1], (size, len(bounds)))
    centred = anywhere - target.parameters(np.zeros((1, len(bounds))))
    u[from_prior] = np.linalg.solve(target.factor, centred.T).T[from_prior]
    log_volume = np.log(np.ptp(bounds, axis=1)).sum() - np.linalg.slogdet(target.factor)[1]
    with np.errstate(all="ignore"):
        b, log_target = target.drawn(u, rng)
        log_proposal = np.logaddexp(
            np.log(1.0 - PRIOR_SHARE) + proposal.log_density(u), np.log(PRIOR_SHARE) - log_volume
        )
        log_weights = log_target - log_proposal
    ends = target.nist_set.bounds
    inside = np.all((b > ends[:, 0]) & (b < ends[:, 1]), axis=1)
    exchangeable = b[:, [names.index(name) for name in target.nist_set.curve.ordered]]
    inside &= np.all(np.diff(exchangeable, axis=1) > 0.0, axis=1)
    return u, np.where(inside & np.isfinite(log_weights), log_weights, -np.inf), b


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
    parser = rows.parser(__doc__)
    parser.add_argument("--sets", nargs="*", choices=list(CURVES), default=list(CURVES))
    options = parser.parse_args()
    rows.append(options.output / FILE, tasks_of(options.sets), run, SEED, options.processes)


if __name__ == "__main__":
    main()
