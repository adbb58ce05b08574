"""The voltage of a capacitance that charges through a resistance."""

from __future__ import annotations

import math

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit

EPSILON = float(np.finfo(float).eps)


def charged_voltage(
    knots: FloatArray, voltage: FloatArray, gain: FloatArray, decay: FloatArray, times: FloatArray
) -> FloatArray:
    r"""Voltage v (W, N) at separate times for every draw; v is zero before the first knot.

    v' = kappa (g V - v) is (4) of Sarban et al. (2012). At s after a knot, with V = p0 + m s,

    v = v(0) exp(-kappa s) + g (p0 psi_0 + m (s - psi_0 / kappa)),   psi_0 = 1 - exp(-kappa s).

    Parameters
    ----------
    knots, voltage : (M,) knots of V, which is linear between them; a repeated knot is a jump.
    gain, decay : g and kappa [1/s] (W,); a decay that is not positive gives a row of NaN.
    times : (W, N), in any order.
    """
    response = np.empty(times.shape)
    decay = np.where(decay > 0.0, decay, np.nan)
    _advance_voltage(knots, voltage, gain, decay, times, response)
    return response


@njit(cache=True)
def _advance_voltage(knots, voltage, gain, decay, times, response) -> None:  # type: ignore[no-untyped-def]
    """Fill response (W, N) with v."""
    last = knots.size - 1
    # As in `linear.hold`, steps that differ only by rounding share one exponential.
    resolution = 4.0 * EPSILON * max(abs(knots[0]), abs(knots[last]))
    slopes, charged = np.zeros(knots.size), np.zeros(knots.size)
    for k in range(last):
        if knots[k + 1] > knots[k]:
            slopes[k] = (voltage[k + 1] - voltage[k]) / (knots[k + 1] - knots[k])
    for w in range(times.shape[0]):
        g, kappa, s, grown = gain[w], decay[w], 0.0, 0.0
        for k in range(last):
            step = knots[k + 1] - knots[k]
            if not abs(step - s) <= resolution:
                s, grown = step, -math.expm1(-kappa * step)
            rise = voltage[k] * grown + slopes[k] * (s - grown / kappa)
            charged[k + 1] = charged[k] * (1.0 - grown) + g * rise
        k = 0
        for i in range(times.shape[1]):
            while k < last and knots[k + 1] <= times[w, i]:
                k += 1
            while k > 0 and knots[k] > times[w, i]:
                k -= 1
            step = max(times[w, i] - knots[k], 0.0)
            if not abs(step - s) <= resolution:
                s, grown = step, -math.expm1(-kappa * step)
            rise = voltage[k] * grown + slopes[k] * (s - grown / kappa)
            response[w, i] = charged[k] * (1.0 - grown) + g * rise
