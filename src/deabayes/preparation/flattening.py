"""How much the mean over a bin takes off a response that oscillates."""

from __future__ import annotations

import numpy as np

from deabayes.preparation.working import WorkingRecord

NOTED = 0.005
"""Of an amplitude: what a bin may take off it without a word."""


def width_for(share: float, frequency: float) -> float:
    """Of a bin [s] that takes a small share off a sine's amplitude [Hz].

    A mean over w leaves sin(x) / x of it, x = pi w f: it takes x^2 / 6 off.
    """
    return float(np.sqrt(6.0 * share) / (np.pi * frequency))


def harmonics(record: WorkingRecord) -> int:
    """Highest multiple of the excitation's frequency that a response has much of.

    Motions follow the square of a voltage: all of that of a sine through zero is at twice its
    frequency, and a part of that of any other.
    """
    return 2 if record.row.excitation == "voltage" else 1
