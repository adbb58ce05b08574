"""Quasi-static records: a stage pulls the slider slowly out and back, a load cell reads."""

from __future__ import annotations

import numpy as np
from data.make.minimum_energy_structure_truth import LOAD_CELL, Truth

from deabayes.experiment import FloatArray

SPEED = 2e-5
"""Of the stage [m/s]."""
LOWEST, HIGHEST = -2e-3, 12e-3
"""Ends of the stroke [m]."""
SPACING = 2.5e-4
"""Between two readings [m]."""
TRAVEL = (HIGHEST - LOWEST) / SPEED
"""Time for one way [s]."""


def positions() -> FloatArray:
    """Slider positions (N,) of a record [m]."""
    return np.asarray(np.linspace(LOWEST, HIGHEST, round((HIGHEST - LOWEST) / SPACING) + 1))


def measured(truth: Truth, voltage: float, rng: np.random.Generator) -> FloatArray:
    """The load cell's readings [N] on the way out and on the way back, their mean (N,)."""
    places = positions().size
    time = np.asarray(np.linspace(0.0, 2.0 * TRAVEL, 2 * places - 1))
    reading = LOAD_CELL.read(lambda t: force(truth, voltage, t), time, rng)
    return 0.5 * (reading[:places] + reading[: places - 2 : -1])


def force(truth: Truth, voltage: float, time: FloatArray) -> FloatArray:
    """Outwards along the slider [N] at times (N,) since it left the inner end for the outer.

    Before, the slider went there from rest at the same speed; the Maxwell units were relaxed.
    """
    out = time <= TRAVEL
    position = np.where(out, LOWEST + SPEED * time, HIGHEST - SPEED * (time - TRAVEL))
    speed = np.where(out, SPEED, -SPEED)
    found = static_force(truth, voltage, position) - truth.eta_0 * speed
    found = found - truth.dry_friction * np.tanh(speed / truth.dry_friction_speed)
    for k, tau in zip(truth.k, truth.tau, strict=True):
        found = found - k * _extension(tau, time)
    return found


def static_force(truth: Truth, voltage: float, position: FloatArray) -> FloatArray:
    """The structure's force [N] at slider positions (N,) [m], all units relaxed."""
    cosine = position / (2.0 * truth.link_length) + np.cos(truth.rest_angle)
    angle = np.arccos(cosine)
    return truth.static_force(angle, cosine, np.sin(angle), voltage)


def _extension(tau: float, time: FloatArray) -> FloatArray:
    """Of a Maxwell unit's spring [m]: steps of the speed, each forgotten with the time tau."""
    found = np.zeros(time.shape)
    for start, change in ((LOWEST / SPEED, -SPEED), (0.0, 2.0 * SPEED), (TRAVEL, -2.0 * SPEED)):
        found = found - change * tau * np.expm1(-np.maximum(time - start, 0.0) / tau)
    return found
