"""Electrostatic pressure between compliant electrodes, and the voltage that causes it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import Excitation, FloatArray
from deabayes.faults import UserError
from deabayes.integrate.drive import Drive, drive

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


OF_TOLERANCE = 0.1
"""Error allowed in the voltage's pieces, relative to its peak, over the response's tolerance."""


def voltage_history(
    excitation: Excitation, times: FloatArray, tolerance: float, before: float = 0.0
) -> Drive:
    """Return a voltage as pieces: linear between knots, or smooth if the knots sample a curve.

    A repeated time is a jump, and so is a first value other than `before`. After the last knot
    the voltage stays constant.

    Parameters
    ----------
    times : (N,) ascending times that the pieces must span [s].
    tolerance : error of the response relative to its range.
    before : voltage before the first knot [V].

    Raises
    ------
    UserError
        If times or voltages are not finite, or the times do not ascend.
    """
    knots = np.asarray(excitation.coordinate, dtype=float)
    volts = np.asarray(excitation.values, dtype=float)
    if not (np.all(np.isfinite(knots)) and np.all(np.isfinite(volts))):
        raise UserError("excitation 'voltage': times and voltages must be finite")
    if np.any(np.diff(knots) < 0.0):
        raise UserError("excitation 'voltage': times must ascend; sort the record by time")
    span = float(times[0]), float(times[-1])
    return drive(knots, volts, *span, OF_TOLERANCE * tolerance, excitation.noisy, before)
