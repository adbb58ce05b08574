"""How much the mean over a bin takes off a response that oscillates."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.passes import passes, usual_period
from deabayes.preparation.working import WorkingRecord

NOTED = 0.005
"""Of an amplitude: what a bin may take off it without a word."""
FEWEST_PASSES = 3


def flattening(width: float, frequency: float) -> float:
    """Share of the amplitude that the mean over `width` [s] takes off a sine [Hz].

    1 - |sin(x) / x| with x = pi width frequency, which is x^2 / 6 for narrow bins.
    """
    return float(1.0 - np.abs(np.sinc(width * frequency)))


def width_for(share: float, frequency: float) -> float:
    """Of a bin [s] that takes a small share off a sine's amplitude [Hz]."""
    return float(np.sqrt(6.0 * share) / (np.pi * frequency))


def harmonics(record: WorkingRecord) -> int:
    """Highest multiple of the excitation's frequency that a response has much of.

    Motions follow the square of a voltage: all of that of a sine through zero is at twice its
    frequency, and a part of that of any other.
    """
    return 2 if record.row.excitation == "voltage" else 1


def warned(record: WorkingRecord, spread: FloatArray) -> WorkingRecord:
    """A record with a warning if its bins flatten what follows a periodic excitation.

    Parameters
    ----------
    spread : (M,) standard deviation of the times behind each point [s].
    """
    times = passes(record.excitation_coordinate, record.excitation)
    if times.size < FEWEST_PASSES:
        return record
    frequency = 1.0 / usual_period(times)
    width = float(np.sqrt(12.0) * np.median(spread))
    lost = [flattening(width, k * frequency) for k in range(1, harmonics(record) + 1)]
    if lost[-1] <= NOTED:
        return record
    twice = f", at twice that by {lost[-1]:.1%}" if len(lost) > 1 else ""
    narrow = width_for(0.1 * NOTED, len(lost) * frequency)
    return record.with_warning(
        f"bins of {width:.3g} s flatten a response at the {frequency:.4g} Hz of the "
        f"{record.row.excitation} by {lost[0]:.1%}{twice}; bins of {narrow:.2g} s or less do not: "
        "give `average` that `width` and thin with `decimate`, or use the step `cycles`"
    )
