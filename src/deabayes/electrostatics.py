"""Electrostatics of a dielectric elastomer between compliant electrodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""epsilon_0 [F/m], CODATA 2022."""


def maxwell_pressure(
    voltage: ArrayLike, thickness: ArrayLike, relative_permittivity: ArrayLike
) -> FloatArray:
    r"""Electrostatic pressure sigma = epsilon_0 epsilon_r (v / d)^2 [Pa].

    Sarban et al. (2012), with v the voltage across the capacitance, (6).

    Parameters
    ----------
    voltage : v [V].
    thickness : d [m].
    relative_permittivity : epsilon_r [1].
        All three broadcast against each other.
    """
    field = np.asarray(voltage, dtype=float) / np.asarray(thickness, dtype=float)
    return VACUUM_PERMITTIVITY * np.asarray(relative_permittivity, dtype=float) * field**2
