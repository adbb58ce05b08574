"""Probability integral transforms of a record's points, each given those before it."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray

ENOUGH_DRAWS = 20.0
"""Effective draws below which weights stay as they are."""


def transforms(
    scores: FloatArray, log_density: FloatArray | None = None, enough: float = ENOUGH_DRAWS
) -> FloatArray:
    r"""PIT (N,) of points, uniform and independent if model and noise hold.

    .. math:: u_k = \sum_s w_{sk} \Phi(e_{sk}), \quad w_{sk} \propto p(y_1, ..., y_{k-1} | theta_s)

    where e are a draw's innovations: p(y_k | y_1..k-1) is a mean over the posterior *given those
    points*, so a record that the fit has not seen is learned from point by point. With equal
    weights a right model's error, smooth along a record, would count at each point anew.

    Parameters
    ----------
    scores : (S, N) innovations, standard normal for a right draw; rows with NaN do not count.
    log_density : (S, N) log p(y_k | y_1..k-1, theta_s) of a held-out record; None where the
        draws have seen the record: equal weights.
    enough : effective draws; from the first point with fewer weights stay what they were, as a
        few draws would be all that is left.
    """
    from scipy.special import ndtr

    finite = np.all(np.isfinite(scores), axis=1)
    if log_density is not None:
        finite &= np.all(np.isfinite(log_density), axis=1)
    if not finite.any():
        return np.full(scores.shape[1], np.nan)
    each = ndtr(scores[finite])
    if log_density is None:
        return np.asarray(each.mean(axis=0))
    return np.asarray(np.sum(_weights(log_density[finite], enough) * each, axis=0))


def _weights(log_density: FloatArray, enough: float) -> FloatArray:
    """(S, N), each point's sum is 1; the first point's are equal."""
    before = np.cumsum(log_density, axis=1) - log_density
    weights = np.exp(before - before.max(axis=0))
    weights /= weights.sum(axis=0)
    few = 1.0 / np.sum(weights**2, axis=0) < min(enough, 0.5 * len(weights))
    if few.any():
        first = max(int(np.argmax(few)), 1)
        weights[:, first:] = weights[:, first - 1 : first]
    return weights
