"""The sine in a record: its frequency, amplitude and phase by least squares."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.passes import passes, usual_period

KILOVOLT = 1e3


def frequency_of(time: FloatArray, values: FloatArray) -> float:
    """Of a sampled sine [Hz], from its passes of its mid-range; NaN below two."""
    return 1.0 / usual_period(passes(time, values))


def phasor(time: FloatArray, values: FloatArray, frequency: float) -> complex:
    """a exp(i phi) of the a sin(2 pi f t + phi) that fits best beside a mean and a drift."""
    angle = 2.0 * np.pi * frequency * time
    drift = (time - time.mean()) / np.ptp(time)
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(time), drift])
    sine, cosine = np.linalg.lstsq(basis, values, rcond=None)[0][:2]
    return complex(sine, cosine)


def drive_of(experiment: Experiment) -> tuple[float, float] | None:
    """Amplitude [V] and highest frequency [Hz] of the amplifier's sine; None without one.

    A sine's are fitted to what was recorded of it where the response was; those of a frequency
    response are stated, `amplitude_kV`.
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
