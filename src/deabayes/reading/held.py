"""A voltage that is held, but for what its monitor adds, and one that is on from the start."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray

STEPS = ("creep", "step")
HELD_CONSTANT = 0.01
MONITOR_NOISE = 10.0
"""Range of a voltage at rest [V]; the electrostatic force at 10 V is 1e-5 of that at 3 kV."""
WIDEST_NOISE = 12.0
"""Range of white noise over its standard deviation; that of 10^5 normal numbers is 9."""


def is_held(voltage: FloatArray) -> bool:
    """Whether a voltage [V] is constant but for 1 % of it or a monitor's noise."""
    allowed = max(HELD_CONSTANT * abs(float(np.mean(voltage))), MONITOR_NOISE)
    return float(np.ptp(voltage)) <= allowed


def is_step_from_the_start(protocol: str, excitation: FloatArray, unit: str) -> bool:
    """Whether a creep's or step's excitation is there from its first sample on, and constant.

    A voltage is so with its monitor's noise, which changes from sample to sample: a small step on
    a bias, or a drift, is none.
    """
    spread, size = float(np.ptp(excitation)), abs(float(np.mean(excitation)))
    noise = float(np.std(np.diff(excitation))) / np.sqrt(2.0) if unit == "V" else 0.0
    constant = spread <= WIDEST_NOISE * noise and is_held(excitation)
    return protocol in STEPS and constant and spread < size


def excitation_range(protocol: str, excitation: FloatArray, unit: str) -> float:
    """Largest change of an excitation, that to its first sample where it is a step there."""
    if is_step_from_the_start(protocol, excitation, unit):
        return float(np.max(np.abs(excitation)))
    return float(np.ptp(excitation))
