"""Properties of sampled curves: the highest point, and the sine in a record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.integrate.periodic import passes, usual_period

POINTS = 401
CLOSER = np.linspace(0.0, 1.0, 21)
ROUNDS = 7
"""Each round shortens the interval to a tenth: at the end it is 1e-7 of the first spacing."""


def peak(
    curve: Callable[[FloatArray], FloatArray], highest: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the place of the maximum of a curve on [0, highest] and its value, each (W,).

    First the best point of an even grid is found. Around this point the curve is assumed to
    have one peak. A draw whose curve is not finite gives NaN.

    Parameters
    ----------
    curve : abscissae (W, P) -> values (W, P).
    highest : (W,).
    """
    low, high = np.zeros_like(highest), highest
    for fractions in (np.linspace(0.0, 1.0, POINTS), *(CLOSER,) * ROUNDS):
        places = low[:, None] + (high - low)[:, None] * fractions
        values = curve(places)
        best = np.argmax(values, axis=1)
        rows, last = np.arange(best.size), fractions.size - 1
        place, value = places[rows, best], values[rows, best]
        low, high = places[rows, np.maximum(best - 1, 0)], places[rows, np.minimum(best + 1, last)]
    return np.where(np.isfinite(value), place, np.nan), value


KILOVOLT = 1e3


def frequency_of(time: FloatArray, values: FloatArray) -> float:
    """Frequency [Hz] of a sampled sine from its passes of mid-range; NaN with fewer than two."""
    return 1.0 / usual_period(passes(time, values))


def phasor(time: FloatArray, values: FloatArray, frequency: float) -> complex:
    """Return a exp(i phi) of the best fit a sin(2 pi f t + phi) plus a mean and a linear drift."""
    angle = 2.0 * np.pi * frequency * time
    drift = (time - time.mean()) / np.ptp(time)
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(time), drift])
    sine, cosine = np.linalg.lstsq(basis, values, rcond=None)[0][:2]
    return complex(sine, cosine)


def drive_of(experiment: Experiment) -> tuple[float, float] | None:
    """Return amplitude [V] and highest frequency [Hz] of the amplifier's sine, or None.

    For a sine record both are fitted to the excitation at the times of the response. For a
    frequency response the amplitude is the stated `amplitude_kV`.
    """
    if experiment.protocol == "frequency_response":
        stated = experiment.metadata.get("amplitude_kV")
        if not isinstance(stated, int | float):
            return None
        return KILOVOLT * float(stated), float(experiment.coordinate.max())
    if experiment.protocol != "sine":
        return None
    time = experiment.coordinate
    values = experiment.excitation.at(time)
    frequency = frequency_of(time, values)
    if not np.isfinite(frequency):
        return None
    return abs(phasor(time, values, frequency)), frequency
