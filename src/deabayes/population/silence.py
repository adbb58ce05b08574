"""Of which parameters a specimen's records say nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray

SILENT = 0.1
"""Contraction, 1 - var_posterior / var_prior, below which records may say nothing."""
DISTANCE = 1.36
"""Kolmogorov's: one in twenty of the distances of n draws' distribution from its law, times the
root of n, is larger."""
NORMAL = 0.02
"""The same of a prior's draws, about twice what 20 000 scatter by; 0.06 of a uniform."""


def telling(phi: FloatArray, prior_phi: FloatArray, independent: float) -> NDArray[np.bool_]:
    """Which of a specimen's parameters (d,) its records tell anything of.

    Not one of which the draws are as wide as the prior's, and distributed like them as far as
    their number can show. One with a normal prior always counts: dividing by it is exact, so that
    the little that many specimens tell adds up to what it is.

    Parameters
    ----------
    phi : (K, d), draws of the posterior, worth `independent` ones.
    prior_phi : (N, d), draws of the prior.
    """
    return np.array(
        [
            _normal(before)
            or _contraction(after, before) >= SILENT
            or _distance(after, before) > DISTANCE / np.sqrt(independent)
            for after, before in zip(phi.T, prior_phi.T, strict=True)
        ]
    )


def _normal(draws: FloatArray) -> bool:
    from scipy.special import ndtr

    ordered = np.sort((draws - draws.mean()) / draws.std())
    above = np.arange(1, len(draws) + 1) / len(draws)
    return bool(np.max(np.abs(above - ndtr(ordered))) < NORMAL)


def _contraction(after: FloatArray, before: FloatArray) -> float:
    """By half the distance of the 16 and 84 % quantiles: tails do not count."""
    new, old = (np.ptp(np.quantile(draws, [0.16, 0.84])) for draws in (after, before))
    return float(1.0 - (new / old) ** 2)


def _distance(after: FloatArray, before: FloatArray) -> float:
    """The largest of the two draws' distribution functions."""
    from scipy.stats import ks_2samp

    return float(ks_2samp(after, before).statistic)
