"""A voltage that is held, but for what its monitor adds, and one that is on from the start."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray

STEPS = ("creep", "step")
HELD_CONSTANT = 0.01
MONITOR_NOISE = 10.0
"""Range of a voltage at rest [V]; the electrostatic force at 10 V is 1e-5 of that at 3 kV."""


def is_held(voltage: FloatArray) -> bool:
    """Whether a voltage [V] is constant but for 1 % of it or a monitor's noise."""
    allowed = max(HELD_CONSTANT * abs(float(np.mean(voltage))), MONITOR_NOISE)
    return float(np.ptp(voltage)) <= allowed


def is_step_from_the_start(protocol: str, excitation: FloatArray, unit: str) -> bool:
    """Whether a creep's or step's excitation is there from its first sample on, and constant.

    A voltage is so with its monitor's noise; a small step of a stretch would look alike.
    """
    spread, size = float(np.ptp(excitation)), abs(float(np.mean(excitation)))
    constant = is_held(excitation) if unit == "V" else spread == 0.0
    return protocol in STEPS and constant and spread < size


def excitation_range(protocol: str, excitation: FloatArray, unit: str) -> float:
    """Largest change of an excitation, that to its first sample where it is a step there."""
    if is_step_from_the_start(protocol, excitation, unit):
        return float(np.max(np.abs(excitation)))
    return float(np.ptp(excitation))
