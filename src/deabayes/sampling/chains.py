"""Rank-normalised R-hat and effective sample size of many short chains.

The definitions are those of Vehtari, Gelman, Simpson, Carpenter and Bürkner (2021),
Bayesian Analysis 16(2), 667-718, and are tested against `arviz_stats`. They are computed here,
because every check of a running sampler treats hundreds of walkers as chains. The
autocovariance is averaged over chains before it is transformed back. A check is then about ten
times cheaper.

Values have the shape (ensembles, steps, walkers). Walkers of one ensemble interact. R-hat
therefore treats an *ensemble* as one chain in time order. Effective sample sizes treat every
walker as a chain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray


def rank_normalise(values: FloatArray) -> FloatArray:
    """Replace values by the normal scores of their ranks, z = Phi^-1((r - 3/8)/(n + 1/4))."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    ranks = rankdata(values, method="average").reshape(values.shape)
    return ndtri((ranks - 0.375) / (values.size + 0.25))


def _halves(chains: FloatArray) -> FloatArray:
    """Split every chain (M, N) in time: (2M, N // 2)."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _potential_scale_reduction(chains: FloatArray) -> float:
    n = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean()
    between = chains.mean(axis=1).var(ddof=1)
    if within == 0:
        return 1.0 if between == 0 else float("inf")
    return float(np.sqrt((n - 1) / n + between / within))


def r_hat(values: FloatArray) -> float:
    """Return the rank-normalised split R-hat of values (E, S, W), the larger of location and scale.

    R-hat is NaN if a value is NaN or if there are fewer than four steps.
    """
    if np.isnan(values).any() or values.shape[1] < 4:
        return float("nan")
    steps = values.shape[1] // 2 * 2
    split = _halves(values[:, :steps].reshape(len(values), -1))
    folded = np.abs(split - np.median(split))
    return max(_potential_scale_reduction(rank_normalise(part)) for part in (split, folded))


def _autocovariance(chains: FloatArray) -> FloatArray:
    """Return the autocovariance (N,) averaged over chains (M, N)."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = chains.shape[1]
    length = next_fast_len(2 * n, real=True)
    transform = rfft(chains - chains.mean(axis=1, keepdims=True), n=length, axis=1)
    power = (transform.real**2 + transform.imag**2).mean(axis=0)
    return irfft(power, n=length)[:n] / n


def effective_sample_size(chains: FloatArray) -> float:
    """Effective sample size of the mean of chains (M, N), with Geyer's monotone sequence."""
    count, n = chains.shape
    covariance = _autocovariance(chains)
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (chains.mean(axis=1).var(ddof=1) if count > 1 else 0.0)
    if not total > np.finfo(float).tiny:
        return float(chains.size)
    correlation = 1 - (within - covariance) / total
    correlation[0] = 1.0
    usable = max(n - 3, 2) // 2 * 2
    pairs = correlation[:usable].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    end = int(negative[0]) if len(negative) else len(pairs)
    following = max(correlation[2 * end], 0.0) if 2 * end < n else 0.0
    tau = -1 + 2 * np.minimum.accumulate(pairs[:end]).sum() + following
    return float(chains.size / max(tau, 1 / np.log10(chains.size)))


def _as_chains(values: FloatArray) -> FloatArray:
    """Turn values (E, S, W) into chains, two halves of each walker, (2 E W, S // 2)."""
    chains = np.ascontiguousarray(values.transpose(0, 2, 1)).reshape(-1, values.shape[1])
    return _halves(chains)


def ess_bulk(values: FloatArray) -> float:
    """Bulk effective sample size of values (E, S, W), pooled over all walkers."""
    if np.isnan(values).any() or values.shape[1] < 8:
        return float("nan")
    return effective_sample_size(rank_normalise(_as_chains(values)))


def ess_mean(values: FloatArray) -> float:
    """Effective sample size for the mean itself, without rank normalisation."""
    if not np.isfinite(values).all() or values.shape[1] < 8:
        return float("nan")
    return effective_sample_size(_as_chains(values))


def ess_tail(values: FloatArray) -> float:
    """The smaller effective sample size of the 5 % and 95 % quantiles of values (E, S, W)."""
    if np.isnan(values).any() or values.shape[1] < 8:
        return float("nan")
    limits = np.quantile(values, [0.05, 0.95])
    return min(
        effective_sample_size(_as_chains((values <= limit).astype(float))) for limit in limits
    )


def thin_evenly(steps: int, limit: int) -> NDArray[np.intp]:
    """Return indices of at most `limit` evenly spaced steps, ending with the last step."""
    stride = max(1, -(-steps // limit))
    return np.arange(steps - 1, -1, -stride)[::-1]
