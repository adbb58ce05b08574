"""How far predictions are from observations, as the papers measure it and as forecasters do.

The papers' measures (equations.md section 4) compare curves; the scores of
samples (CRPS, coverage, joint log score) judge a predictive distribution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray


def relative_maximum_error(observed: ArrayLike, predicted: ArrayLike) -> FloatArray:
    """e_m = max|y - f| / (max y - min y), one value per predicted curve.

    Parameters
    ----------
    observed : y (N,).
    predicted : f (..., N), any leading axes, e.g. draws (W, N).

    Returns
    -------
    ndarray
        (...), a fraction of the observed range; NaN where a curve is not finite.

    Raises
    ------
    ValueError
        If the lengths differ, or the observations do not vary or are not finite.
    """
    observed, predicted = _curves(observed, predicted)
    return np.max(np.abs(observed - predicted), axis=-1) / np.ptp(observed)


def relative_rms_error(observed: ArrayLike, predicted: ArrayLike) -> FloatArray:
    """e_rms = sqrt(mean (y - f)^2) / (max y - min y), one value per predicted curve.

    Shapes and errors as in `relative_maximum_error`.
    """
    observed, predicted = _curves(observed, predicted)
    return np.sqrt(np.mean((observed - predicted) ** 2, axis=-1)) / np.ptp(observed)


def crps(observed: ArrayLike, samples: ArrayLike) -> FloatArray:
    """Continuous ranked probability score of S samples at each point, in the response's unit.

    The fair estimate, unbiased in S (Ferro 2014, Q. J. R. Meteorol. Soc. 140:1917):
    CRPS = mean_i |x_i - y| - 1 / (2 S (S - 1)) sum_ij |x_i - x_j|, its double
    sum from the order statistics, O(S log S). It may be slightly negative.

    Parameters
    ----------
    observed : y (N,).
    samples : x (S, N), S >= 2.

    Returns
    -------
    ndarray
        (N,); smaller is better.
    """
    observed, samples = _samples(observed, samples)
    size = samples.shape[0]
    if size < 2:
        raise ValueError(f"crps needs at least 2 samples, got {size}")
    ordered = np.sort(samples - observed, axis=0)
    rank_weights = 2.0 * np.arange(1, size + 1) - size - 1.0
    spread = rank_weights @ ordered / (size * (size - 1.0))
    return np.mean(np.abs(ordered), axis=0) - spread


def interval_coverage(observed: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Share of the observations (N,) inside the intervals from `lower` to `upper` (N,)."""
    observed, lower = _same_length(observed, lower)
    observed, upper = _same_length(observed, upper)
    return float(np.mean((lower <= observed) & (observed <= upper)))


def joint_log_score(log_likelihood: ArrayLike) -> float:
    """log p(y | data) = log mean_s p(y | theta_s) of a whole record; larger is better.

    Parameters
    ----------
    log_likelihood : log p(y | theta_s) (S,) of the record under each posterior
        draw; a draw whose response failed has -inf.
    """
    from scipy.special import logsumexp

    log_likelihood = np.asarray(log_likelihood, dtype=float)
    if log_likelihood.ndim != 1 or log_likelihood.size == 0:
        raise ValueError(f"log_likelihood must be (S,), got shape {log_likelihood.shape}")
    return float(logsumexp(log_likelihood) - np.log(log_likelihood.size))


def draws_behind_joint_log_score(log_likelihood: ArrayLike) -> float:
    """How many draws carry log mean_s p(y | theta_s): (sum_s p_s)^2 / sum_s p_s^2 (Kish 1965).

    Near 1 the score is that of the best draw, too low by an unknown amount and another with
    other draws. Zero where no draw has a response.

    Parameters
    ----------
    log_likelihood : as in `joint_log_score`.
    """
    from scipy.special import logsumexp

    log_likelihood = np.asarray(log_likelihood, dtype=float)
    if not np.isfinite(log_likelihood).any():
        return 0.0
    return float(np.exp(2.0 * logsumexp(log_likelihood) - logsumexp(2.0 * log_likelihood)))


def uniformity_p(pit: ArrayLike) -> float:
    """p-value of a Kolmogorov-Smirnov test that values (N,) are uniform on [0, 1].

    They are taken to be independent. NaN where one is not finite.

    Below 0.1, and for distances of 0.5 and more, p is twice the exact one-sided probability, less
    than 1e-4 off. Else it is the limiting law at a corrected distance (Vrbik 2018, Pioneer J.
    Theor. Appl. Stat. 15), less than 1e-3 off from 20 points on.
    """
    from scipy.special import kolmogorov, smirnov

    pit = np.sort(np.asarray(pit, dtype=float))
    if not np.isfinite(pit).all():
        return float("nan")
    n = pit.size
    distance = float(np.max([np.arange(1, n + 1) / n - pit, pit - np.arange(n) / n]))
    twice = 2.0 * float(smirnov(n, distance))
    if twice < 0.1 or distance >= 0.5:
        return twice
    root = np.sqrt(n)
    corrected = distance * root + 1.0 / (6.0 * root) + (distance * root - 1.0) / (4.0 * n)
    return float(kolmogorov(corrected))


def _curves(observed: ArrayLike, predicted: ArrayLike) -> tuple[FloatArray, FloatArray]:
    observed, predicted = _same_length(observed, predicted)
    span = np.ptp(observed)
    if not np.isfinite(span) or span == 0.0:
        raise ValueError("a relative error needs finite observations that vary")
    return observed, predicted


def _samples(observed: ArrayLike, samples: ArrayLike) -> tuple[FloatArray, FloatArray]:
    observed, samples = _same_length(observed, samples)
    if samples.ndim != 2:
        raise ValueError(f"samples must be (S, N), got shape {samples.shape}")
    return observed, samples


def _same_length(observed: ArrayLike, other: ArrayLike) -> tuple[FloatArray, FloatArray]:
    observed, other = np.asarray(observed, dtype=float), np.asarray(other, dtype=float)
    # Broadcasting would accept a single value for a whole record.
    if observed.ndim != 1 or other.ndim == 0 or other.shape[-1] != observed.size:
        raise ValueError(
            f"observations {observed.shape} and predictions {other.shape} differ in length"
        )
    return observed, other
