"""How far a posterior moves when its prior, or its likelihood, is given more or less weight."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.pareto import UNRELIABLE_K_HAT, smoothed

ALPHAS = (0.99, 1.01)
SENSITIVE = 0.05
"""From here on a quantity counts as moved (Kallioinen et al. 2024)."""
BY_CHANCE = 0.5
"""Of quantities that do not move, 95 % show less than this times sd(log c) / sqrt(draws).

Measured on 150 sets of 400 to 8000 independent normal draws with 15 parameters: 0.46 to 0.53."""


def sensitivities(
    log_component: FloatArray,
    quantities: Mapping[str, FloatArray],
    effective_draws: Mapping[str, float],
) -> dict[str, float]:
    r"""Power-scaling sensitivity of every quantity to one component of the posterior.

    The component's density is raised to alpha, so that p_alpha(theta) ~ p(theta | y)
    c(theta)^{alpha-1}; draws of the posterior become draws of p_alpha with the weights
    c(theta)^{alpha-1}, Pareto-smoothed. With the cumulative Jensen-Shannon distance

    D(P, Q)^2 = [int P log2(2P/(P+Q)) + Q log2(2Q/(P+Q)) dx] / int (P + Q) dx

    of two distribution functions (the larger of it for x and for -x), the sensitivity is its
    slope against log2 alpha at alpha = 1, from an alpha on either side (Kallioinen, Paananen,
    Buerkner and Vehtari 2024, Statistics and Computing 34, 57; computed by arviz_stats). A
    shift of x or another unit leaves D as it is, a logarithm does not.

    Parameters
    ----------
    log_component : (S,) log c of every draw, up to a constant.
    quantities : draws (S,) by name.
    effective_draws : how many independent draws those are worth, by name.

    Returns
    -------
    dict
        NaN where it is not known: weights too unequal (Pareto k-hat above 0.7), no more than
        chance would show where that may reach `SENSITIVE` (too few draws), draws that are no
        number or do not vary.
    """
    weights = [_weights((alpha - 1.0) * log_component) for alpha in ALPHAS]
    found = {}
    for name, draws in quantities.items():
        chance = BY_CHANCE * np.std(log_component) / np.sqrt(effective_draws[name])
        moved = _slope(draws, weights)
        found[name] = moved if moved > chance or chance < SENSITIVE else float("nan")
    return found


def _weights(log_weights: FloatArray) -> FloatArray | None:
    """Pareto-smoothed weights that sum to 1; None where they cannot be relied on."""
    weights, k_hat = smoothed(log_weights)
    return np.exp(weights) if k_hat <= UNRELIABLE_K_HAT else None


def _slope(draws: FloatArray, weights: list[FloatArray | None]) -> float:
    from arviz_stats.base import array_stats

    lower, upper = weights
    if lower is None or upper is None or not _varies(draws):
        return float("nan")
    return float(
        array_stats.power_scale_sense(
            draws[None],
            lower[None],
            upper[None],
            lower_alpha=ALPHAS[0],
            upper_alpha=ALPHAS[1],
        )
    )


def _varies(draws: FloatArray) -> bool:
    return bool(np.all(np.isfinite(draws)) and np.ptp(draws) > 0.0)
