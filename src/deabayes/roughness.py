"""How far samples of an excitation scatter about a smooth curve."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray

SIXTH_DIFFERENCE = 0.6745 * np.sqrt(924.0)
"""Median absolute sixth difference of white noise over its standard deviation."""
NOISIEST = 0.01
"""Of the peak: samples that scatter more are levels of their own, not a monitor's noise."""


def roughness(values: FloatArray) -> float:
    """Standard deviation of evenly spaced samples (N,) about a smooth curve (robust).

    From sixth differences, which a sine of 40 samples per period passes with 1e-5 of its
    amplitude; steps and corners are too few to count. 0 where it is too much for noise: an
    excitation that changes from sample to sample (random levels, a triangle of few samples) has
    such differences too.
    """
    sixth = np.abs(np.diff(values, 6))
    found = float(np.median(sixth)) / SIXTH_DIFFERENCE if sixth.size else 0.0
    return found if found <= NOISIEST * float(np.max(np.abs(values))) else 0.0
