"""Ornstein-Uhlenbeck plus white noise with an unknown zero offset, for sensors that drift."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, offset_amplitude, variance
from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from deabayes.prior.parameter import Parameter


class OrnsteinUhlenbeckOffset(OrnsteinUhlenbeck):
    """cov(r_j, r_k) = sigma_offset^2 + the covariance of `ornstein_uhlenbeck`.

    Every record has its own constant offset b ~ N(0, sigma_offset^2). The record's zero is the
    mean of a short rest, in which slow noise does not average out. With correlated noise alone,
    the level of a long record would count as known.

    The filter of `ornstein_uhlenbeck` gives innovations e_k of r and a_k of a constant 1, both of
    variance S_k. Given b, the innovations of r are e_k - b a_k. So b given r_1..k-1 is
    N(m_k, v_k), with 1 / v_k = 1 / sigma_offset^2 + sum_j<k a_j^2 / S_j and
    m_k = v_k sum_j<k a_j e_j / S_j. The innovations are e_k - m_k a_k with variances
    S_k + v_k a_k^2.
    """

    name = "ornstein_uhlenbeck_offset"

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        usual = super().parameters(unit, scale, span, coordinate_unit)
        return (*usual, offset_amplitude(unit, scale))

    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        innovation, spread = super().filtered(residuals, coordinate, weights, draws)
        ones, _ = super().filtered(np.ones_like(residuals), coordinate, weights, draws)
        prior = variance(draws["sigma_offset"])[:, None]
        with np.errstate(all="ignore"):
            known = 1.0 + prior * _before(ones**2 / spread)
            mean = prior * _before(ones * innovation / spread) / known
            return innovation - mean * ones, spread + prior / known * ones**2

    def log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        """log p(r), (W,), by a rank-one update of K^-1.

        K is the covariance of `ornstein_uhlenbeck`, whose density gives all quadratic forms. With
        m the mean of r = r' + m 1, s = 1^T K^-1 1, u = 1^T K^-1 r' and w = sigma_offset^2,

        log N(r; 0, K + w 1 1^T) = log N(r'; 0, K) - log(1 + w s) / 2
            + (w u^2 - 2 m u - m^2 s) / (2 (1 + w s)).

        So a large offset costs no digits. Four passes of a compiled kernel are faster than two
        passes that store every innovation.
        """
        law = super().log_prob
        prior = variance(draws["sigma_offset"])
        unit = np.sqrt(variance(draws["sigma_white"]) + variance(draws["sigma_ou"]))
        level = np.broadcast_to(unit[:, None], residuals.shape)
        with np.errstate(all="ignore"):
            middle = residuals.mean(axis=1)
            rest = residuals - middle[:, None]
            usual, none, alone, less = (
                law(values, coordinate, weights, draws)
                for values in (rest, np.zeros_like(rest), level, rest - level)
            )
            precision = 2.0 * (none - alone) / unit**2
            pull = (none - usual - alone + less) / unit
            known = 1.0 + prior * precision
            moved = prior * pull**2 - middle * (2.0 * pull + middle * precision)
            total = usual - 0.5 * np.log(known) + 0.5 * moved / known
        return np.where(np.isfinite(total), total, -np.inf)

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        discrepancy, white = super().sample(rng, coordinate, weights, draws)
        sigma = np.sqrt(variance(draws["sigma_offset"]))[:, None]
        return discrepancy + sigma * rng.standard_normal(sigma.shape), white

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        correlated, white = super().variances(draws, weights)
        return correlated + variance(draws["sigma_offset"]), white


def _before(terms: FloatArray) -> FloatArray:
    """Sums over all points before each point, (W, N)."""
    total = np.zeros_like(terms)
    np.cumsum(terms[:, :-1], axis=1, out=total[:, 1:])
    return total
