"""What the tubular actuator moves: its inertial parameter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray, Quantity

SOURCE = "from total_mass, active_mass and sensor_mass"


def inertial_parameter(
    total_mass: ArrayLike,
    active_mass: ArrayLike,
    sensor_mass: ArrayLike,
    load: ArrayLike,
    active_length: ArrayLike,
    cross_section: ArrayLike,
) -> FloatArray:
    """M = (m_DE + m_LVDT + m_LOAD) L_0 / A_0 [kg/m], Sarban et al. (2012), (13).

    Of the actuator's total mass, the active part and half of the rest move:
    m_DE = m_active + (m_total - m_active) / 2. Masses in kg, L_0 in m, A_0 in m^2; all
    broadcast, so that draws of uncertain masses give draws of M.
    """
    total, active, sensor, hung, length, area = (
        np.asarray(given, dtype=float)
        for given in (total_mass, active_mass, sensor_mass, load, active_length, cross_section)
    )
    return np.asarray((moving_mass(total, active, sensor) + hung) * length / area)


def moving_mass(total: ArrayLike, active: ArrayLike, sensor: ArrayLike) -> FloatArray:
    """m_DE + m_LVDT [kg]: what moves without a load."""
    total, active, sensor = (np.asarray(given, dtype=float) for given in (total, active, sensor))
    return np.asarray(active + 0.5 * (total - active) + sensor)


def moving_quantity(total: Quantity, active: Quantity, sensor: Quantity) -> Quantity:
    """The same of stated masses, with the sd that theirs make; None where none has one."""
    parts = ((total, 0.5), (active, 0.5), (sensor, 1.0))
    value = float(moving_mass(total.value, active.value, sensor.value))
    if all(mass.sd is None for mass, _ in parts):
        return Quantity(value, "kg", None, SOURCE)
    sd = math.sqrt(sum((weight * (mass.sd or 0.0)) ** 2 for mass, weight in parts))
    return Quantity(value, "kg", sd, SOURCE)
