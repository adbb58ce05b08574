"""Find out what decides a posterior: its prior, its likelihood, or a bound of its prior."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import Distribution, LogUniform, Uniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter
from deabayes.quantities import with_unit

UNRELIABLE_K_HAT = 0.7
"""Weights with a larger Pareto shape are not used (Vehtari et al. 2024, JMLR 25(72))."""
EVEN = 0.01
"""If log-weights differ by less than this, no tail is fitted and smoothed.

The tail of a component that is constant up to rounding would consist of rounding errors."""


def smoothed(log_weights: FloatArray) -> tuple[FloatArray, float]:
    """Return logs of smoothed weights (S,) that sum to one, and the Pareto shape of their tail.

    arviz's `psislw` expects the log-likelihood that is left out, which is minus the log weights.
    The shape is infinite if no tail can be fitted: too few draws, or equal weights in the tail.
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


ALPHAS = (0.99, 1.01)
SENSITIVE = 0.05
"""Sensitivity from which a quantity counts as moved (Kallioinen et al. 2024)."""
BY_CHANCE = 0.5
"""Of quantities that do not move, 95 % show less than this times sd(log c) / sqrt(draws).

Measured on 150 sets of 400 to 8000 independent normal draws with 15 parameters: 0.46 to 0.53."""


def sensitivities(
    log_component: FloatArray,
    quantities: Mapping[str, FloatArray],
    effective_draws: Mapping[str, float],
) -> dict[str, float]:
    r"""Return the power-scaling sensitivity of every quantity to one component of the posterior.

    The component's density is raised to alpha: p_alpha(theta) ~ p(theta | y) c(theta)^{alpha-1}.
    Draws of the posterior become draws of p_alpha with the Pareto-smoothed weights
    c(theta)^{alpha-1}. The distance of two distribution functions is the cumulative
    Jensen-Shannon distance D (the larger of its values for x and for -x):

    D(P, Q)^2 = [int P log2(2P/(P+Q)) + Q log2(2Q/(P+Q)) dx] / int (P + Q) dx

    The sensitivity is the slope of D against log2 alpha at alpha = 1, from one alpha on either
    side (Kallioinen, Paananen, Buerkner and Vehtari 2024, Statistics and Computing 34, 57;
    computed by arviz_stats). A shift of x or another unit does not change D, but a logarithm does.

    Parameters
    ----------
    log_component : (S,) log c of every draw, up to a constant.
    quantities : draws (S,) by name.
    effective_draws : effective sample size of these draws, by name.

    Returns
    -------
    dict
        Sensitivity by name. It is NaN if the weights are too unequal (Pareto k-hat above 0.7), or
        if draws are not finite or do not vary. It is also NaN with too few draws: chance alone may
        reach `SENSITIVE`, and the value is not above chance.
    """
    weights = [_weights((alpha - 1.0) * log_component) for alpha in ALPHAS]
    by_name = {}
    for name, draws in quantities.items():
        chance = BY_CHANCE * np.std(log_component) / np.sqrt(effective_draws[name])
        moved = _slope(draws, weights)
        by_name[name] = moved if moved > chance or chance < SENSITIVE else float("nan")
    return by_name


def _weights(log_weights: FloatArray) -> FloatArray | None:
    """Return Pareto-smoothed weights that sum to 1; None if they are not reliable."""
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


OUTERMOST, LEANS = 0.02, 0.25
"""Outermost share of the prior at a bound, and the least share of draws there that is reported."""
FURTHER = 10.0
"""Factor by which the proposed log-uniform prior has its bound further out."""


def leaning(prior: Prior, theta: FloatArray) -> list[str]:
    """Return one sentence per material parameter whose draws theta (W, d) lean on a bound.

    Draws lean on a bound if at least a quarter of them lie in the outermost 2 % of the prior. The
    records then ask for values beyond the bound, and other parameters make up for them.
    """
    inherited = {name for block in prior.inherited for name in block.names}
    return [
        sentence
        for parameter, draws in zip(prior.parameters, theta.T, strict=True)
        if "." not in parameter.name and parameter.name not in inherited
        for sentence in _of_parameter(parameter, draws)
    ]


def _of_parameter(parameter: Parameter, draws: FloatArray) -> Iterator[str]:
    from scipy.special import ndtr

    law = parameter.prior
    if not isinstance(law, LogUniform | Uniform):
        return
    passed = ndtr(law.to_normal(draws))
    ends = {"lower": passed < OUTERMOST, "upper": passed > 1.0 - OUTERMOST}
    for end, near in ends.items():
        share = float(np.mean(near))
        if share < LEANS:
            continue
        bound = with_unit(getattr(law, end), parameter.unit, parameter.name, digits=3)
        yield (
            f"{parameter.name}: {100 * share:.0f} % of its draws lie at the {end} bound of its "
            f"prior, {bound}. The records favour values beyond it, and other parameters "
            f"compensate. Widen the prior in config.yaml: {_line(parameter, law, end)}"
        )


def _line(parameter: Parameter, law: Distribution, end: str) -> str:
    """Return the line for config.yaml that moves this bound of the prior outwards."""
    bounds = {name: float(getattr(law, name)) for name in ("lower", "upper")}
    if isinstance(law, LogUniform):
        bounds[end] *= FURTHER if end == "upper" else 1.0 / FURTHER
    else:
        width = bounds["upper"] - bounds["lower"]
        bounds[end] += width if end == "upper" else -width
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    kind = "loguniform" if isinstance(law, LogUniform) else "uniform"
    said = ", ".join(f"{name}: {value:.4g}{unit}" for name, value in bounds.items())
    key = parameter.ordered or parameter.part_of or parameter.name
    return f"`priors: {{{key}: {{distribution: {kind}, {said}}}}}`"


SMALLEST_CONTRACTION = 0.1
SET_BY_PRIOR = "set by the prior"
MOVED_BY_PRIOR = "moved by the prior"
MOVED_BY_BOTH = "moved by prior and data"


def in_words(row: Mapping[str, float]) -> str:
    """Return the words for a row of summary.csv; empty if the data decided, or if unknown.

    Contraction alone does not show that the prior set a number: data may shift a posterior that
    stays as wide as the prior. The likelihood's sensitivity must therefore be small too, if it is
    known. Files without sensitivities (NaN or no column) are judged by contraction.
    """
    prior = float(row.get("prior_sensitivity", float("nan")))
    likelihood = float(row.get("likelihood_sensitivity", float("nan")))
    if row["contraction"] < SMALLEST_CONTRACTION and not likelihood >= SENSITIVE:
        return SET_BY_PRIOR
    if not prior >= SENSITIVE:
        return ""
    if likelihood >= SENSITIVE:
        return MOVED_BY_BOTH
    return MOVED_BY_PRIOR if likelihood < SENSITIVE else ""
