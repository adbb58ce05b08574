r"""Coordinates of two Ogden terms if records show the film's stress at several stretches.

If records determine the film's stress well, terms with the same stress form a ridge. With v_i
the stress of term i at a reference stretch,

S_k = sum_i v_i psi_k(alpha_i) / psi_1(alpha_i),  psi_k(alpha) = sinh(h_k alpha),
h_1 = (ln lambda_1 - ln lambda_3) / 2,

is the stress of the film if lambda_1 is exp(h_k - h_1) times the reference stretch and lambda_2 is
unchanged. The coordinates are

u: ln S_1, ln S_2 / S_1, ln S_3 / S_2, and alpha_2.

Three of them are constant along the ridge. A map that is learned in these coordinates therefore
also holds outside its draws. For example, a map was fitted to draws of the structure's posterior
with alpha_1 above 0.35. At alpha_1 = 0.14 its log density was wrong by 2 nats, and by 44 nats in
the coordinates of `terms`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, expm1, sqrt

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit

NEAR_ZERO = 1e-4
"""Limit of h alpha below which functions are replaced by the first terms of their series."""
MOST_STEPS = 100
ROUNDING = 4e-16


@dataclass(frozen=True)
class FilmStress:
    """Coordinates of two terms that replace the scores of the exponents and ln v_i.

    Attributes
    ----------
    exponents, stresses : columns of the scores of the exponents, ascending, and of ln v_i.
    middle, sd : mean and standard deviation of the exponents' prior, which has a lower bound of at
        least 0: alpha = middle + sd score.
    heights : (3,) h_k, descending.
    """

    exponents: tuple[int, ...]
    stresses: tuple[int, ...]
    middle: float
    sd: float
    heights: FloatArray

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; return the log of the Jacobian, (W,)."""
        small, large = (self.middle + self.sd * u[:, k] for k in self.exponents)
        log_stresses = u[:, list(self.stresses)]
        stresses, log_jacobian = to_stresses(small, large, log_stresses, self.heights)
        u[:, [*self.stresses, self.exponents[0]]] = stresses
        return log_jacobian + np.log(self.sd)

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`, in place; NaN if no terms have these stresses."""
        first, second = self.exponents
        large = self.middle + self.sd * u[:, second]
        stresses = u[:, [*self.stresses, first]]
        small, log_stresses = to_terms(large, stresses, self.heights)
        u[:, first] = (small - self.middle) / self.sd
        u[:, list(self.stresses)] = log_stresses


@njit(cache=True, error_model="numpy", inline="always")
def _ratio(alpha: float, height: float, largest: float) -> float:
    """Return sinh(height alpha) / sinh(largest alpha)."""
    if largest * alpha < NEAR_ZERO:
        return height / largest * (1.0 + (height**2 - largest**2) * alpha**2 / 6.0)
    numerator, denominator = expm1(-2.0 * height * alpha), expm1(-2.0 * largest * alpha)
    return exp((height - largest) * alpha) * numerator / denominator


@njit(cache=True, error_model="numpy", inline="always")
def _slope(alpha: float, height: float) -> float:
    """Derivative of ln sinh(height alpha) by alpha: height coth(height alpha)."""
    return -height * (1.0 + exp(-2.0 * height * alpha)) / expm1(-2.0 * height * alpha)


@njit(cache=True, error_model="numpy", inline="always")
def _change(alpha: float, height: float, largest: float) -> float:
    """Derivative of `_ratio` by alpha."""
    if largest * alpha < NEAR_ZERO:
        return height / largest * (height**2 - largest**2) * alpha / 3.0
    slopes = _slope(alpha, height) - _slope(alpha, largest)
    return _ratio(alpha, height, largest) * slopes


@njit(cache=True, error_model="numpy")
def to_stresses(
    small: FloatArray, large: FloatArray, log_stresses: FloatArray, heights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ln S_1, ln S_2 / S_1, ln S_3 / S_2, (W, 3), and the log of the Jacobian, (W,).

    The Jacobian is with respect to ln v_1, ln v_2 and alpha_1 at constant alpha_2. With shares V_i
    of S_1 and rho_k = psi_k / psi_1 it is
    V_1^2 V_2 |(rho_2(alpha_1) - rho_2(alpha_2)) rho_3'(alpha_1)
    - (rho_3(alpha_1) - rho_3(alpha_2)) rho_2'(alpha_1)| S_1^2 / (S_2 S_3).

    Parameters
    ----------
    small, large : alpha_1 and alpha_2, (W,).
    log_stresses : ln v_i, (W, 2).
    """
    found, log_jacobian = np.empty((small.size, 3)), np.empty(small.size)
    one, two, three = heights
    for w in range(small.size):
        share = 1.0 / (1.0 + exp(log_stresses[w, 1] - log_stresses[w, 0]))
        other = 1.0 / (1.0 + exp(log_stresses[w, 0] - log_stresses[w, 1]))
        second = _ratio(large[w], two, one)
        third = _ratio(large[w], three, one)
        more_second = _ratio(small[w], two, one) - second
        more_third = _ratio(small[w], three, one) - third
        second, third = second + share * more_second, third + share * more_third
        found[w, 0] = log_stresses[w, 0] - np.log(share)
        found[w, 1] = np.log(second)
        found[w, 2] = np.log(third / second)
        turning = more_second * _change(small[w], three, one)
        turning -= more_third * _change(small[w], two, one)
        factor = share**2 * other / (second * third) * abs(turning)
        log_jacobian[w] = np.log(factor) if small[w] < large[w] else -np.inf
    return found, log_jacobian


@njit(cache=True, error_model="numpy")
def to_terms(
    large: FloatArray, stresses: FloatArray, heights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Invert `to_stresses`: return alpha_1 (W,) and ln v_i (W, 2); NaN if there is no solution.

    (S_3 / S_1 - rho_3(alpha_2)) / (S_2 / S_1 - rho_2(alpha_2)) is the slope of a chord of rho_3
    as a function of rho_2. This function is convex, and the slope decreases as alpha_1 increases.
    Therefore at most one alpha_1 has this slope.
    """
    small, log_stresses = np.empty(large.size), np.empty((large.size, 2))
    for w in range(large.size):
        small[w] = log_stresses[w, 0] = log_stresses[w, 1] = np.nan
        second = _ratio(large[w], heights[1], heights[0])
        third = _ratio(large[w], heights[2], heights[0])
        more_second = exp(stresses[w, 1]) - second
        more_third = exp(stresses[w, 1] + stresses[w, 2]) - third
        if not (large[w] > 0.0 and more_second > 0.0 and more_third > 0.0):
            continue
        alpha = _exponent(large[w], second, third, more_third / more_second, heights)
        share = more_second / (_ratio(alpha, heights[1], heights[0]) - second)
        if 0.0 < share < 1.0:
            small[w] = alpha
            log_stresses[w, 0] = stresses[w, 0] + np.log(share)
            log_stresses[w, 1] = stresses[w, 0] + np.log1p(-share)
    return small, log_stresses


@njit(cache=True, error_model="numpy")
def _exponent(
    large: float, second: float, third: float, wanted: float, heights: FloatArray
) -> float:
    """Return alpha_1 between 0 and alpha_2 for which the chord has the wanted slope, or NaN.

    It is found by the Illinois rule (Dowell and Jarratt 1971, BIT 11, 168). The unknown is
    alpha_1^2, because the ratios are smooth functions of it.
    """
    one, two, three = heights
    low, high = 0.0, large**2
    at_low = (_ratio(0.0, three, one) - third) / (_ratio(0.0, two, one) - second) - wanted
    at_high = _change(large, three, one) / _change(large, two, one) - wanted
    if not (at_low > 0.0 and at_high < 0.0):
        return np.nan
    middle, kept = low, 0
    for _ in range(MOST_STEPS):
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not (low < middle < high):
            break
        alpha = sqrt(middle)
        chord = (_ratio(alpha, three, one) - third) / (_ratio(alpha, two, one) - second)
        at_middle = chord - wanted
        if abs(at_middle) <= ROUNDING * wanted:
            break
        if at_middle > 0.0:
            low, at_low = middle, at_middle
            at_high *= 0.5 if kept == 1 else 1.0
            kept = 1
        else:
            high, at_high = middle, at_middle
            at_low *= 0.5 if kept == -1 else 1.0
            kept = -1
    return sqrt(middle)
