"""Ornstein-Uhlenbeck plus white noise about a zero that is not known: sensors that drift."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, offset_amplitude, variance
from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from deabayes.prior.parameter import Parameter


class OrnsteinUhlenbeckOffset(OrnsteinUhlenbeck):
    """cov(r_j, r_k) = sigma_offset^2 + that of `ornstein_uhlenbeck`.

    Every record is off by a constant b ~ N(0, sigma_offset^2) of its own: its zero is the mean of
    a short rest, and slow noise does not average out in it. Correlated noise alone takes the
    level of a long record for known.

    Given b, innovations of r are e_k - b a_k, with e_k those of r and a_k those of a constant 1,
    both of variance S_k. So b given r_1..k-1 is N(m_k, v_k), 1 / v_k = 1 / sigma_offset^2 +
    sum_j<k a_j^2 / S_j, m_k = v_k sum_j<k a_j e_j / S_j, and the innovations are e_k - m_k a_k
    with variances S_k + v_k a_k^2.
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
        """By the rank-one update of K^-1, of which the usual law's density gives all forms.

        With m the mean of r = r' + m 1, s = 1^T K^-1 1, u = 1^T K^-1 r' and w = sigma_offset^2,

        log N(r; 0, K + w 1 1^T) = log N(r'; 0, K) - log(1 + w s) / 2
            + (w u^2 - 2 m u - m^2 s) / (2 (1 + w s)):

        a zero far off costs no digits so. Four passes of a compiled kernel are faster than two of
        which every innovation is kept.
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
    """Sums over the points before each one, (W, N)."""
    total = np.zeros_like(terms)
    np.cumsum(terms[:, :-1], axis=1, out=total[:, 1:])
    return total
