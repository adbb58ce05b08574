"""Pareto-smoothed importance weights."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray

UNRELIABLE_K_HAT = 0.7
"""Weights with a larger Pareto shape are not relied on (Vehtari et al. 2024, JMLR 25(72))."""
EVEN = 0.01
"""Log-weights that differ by less have no tail to smooth: a component that is constant but for
rounding leaves only its rounding to fit one to."""


def smoothed(log_weights: FloatArray) -> tuple[FloatArray, float]:
    """Logarithms of smoothed weights (S,) that sum to one, and the Pareto shape of their tail.

    arviz's `psislw` takes a log-likelihood to be left out, the weights' logarithm with the
    other sign. The shape is infinite where no tail can be fitted: too few draws, or a tail of
    equal ones.
    """
    from arviz_stats.base import array_stats
    from scipy.special import logsumexp

    k_hat = 0.0
    if not np.ptp(log_weights) <= EVEN:
        try:
            with np.errstate(all="ignore"):
                log_weights, shape = array_stats.psislw(-log_weights, r_eff=1.0)
            k_hat = float(np.nan_to_num(float(shape), nan=np.inf))
        except (ValueError, IndexError):
            k_hat = float("inf")
    return np.asarray(log_weights - logsumexp(log_weights)), k_hat
