"""What the tubular actuator moves: its inertial parameter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray


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
    moving = active + 0.5 * (total - active)
    return np.asarray((moving + sensor + hung) * length / area)
