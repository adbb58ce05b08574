"""What proposals in a prior's parameters have in common: from theta' to z' and its acceptance."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.joint import Prior


def weighed(
    prior: Prior, z: FloatArray, theta: FloatArray, proposed: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """z' (W, d) of theta', and the log of what L'N(z')/(L N(z)) is to be multiplied by, (W,).

    A proposal outside the prior's support is z itself with factor -inf.

    Parameters
    ----------
    theta, proposed : (W, p), of z and as proposed.
    factor : (W,), log of the density with which theta is proposed from theta' over the reverse.
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        moved = prior.to_normal(proposed)
        usable = np.asarray(np.isfinite(moved).all(axis=1))
        moved = np.where(usable[:, None], moved, z)
        change = _log_density(prior, proposed, moved) - _log_density(prior, theta, z)
        change = change + factor - 0.5 * ((z**2).sum(axis=1) - (moved**2).sum(axis=1))
    return moved, np.where(usable & np.isfinite(change), change, -np.inf)


def _log_density(prior: Prior, theta: FloatArray, z: FloatArray) -> FloatArray:
    """Of the prior without what L has of it (`LogPosterior.log_likelihood_of_normal`)."""
    return prior.log_density(theta) - prior.log_correction(theta, z)
