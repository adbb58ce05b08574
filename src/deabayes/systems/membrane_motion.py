"""The membrane in motion: draws followed through a voltage history."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.drive import Drive
from deabayes.systems.membrane_material import Material


@dataclass(frozen=True)
class Motion:
    """Stretch (W, N); steps tried and the time at which a draw was lost, else NaN, (W,)."""

    stretch: FloatArray
    steps: NDArray[np.int64]
    ended: FloatArray


def follow(
    material: Material,
    history: Drive,
    times: FloatArray,
    tolerance: float,
    limit: FloatArray,
    mass: FloatArray | None = None,
) -> Motion:
    """Integrate draws through a voltage history, from rest at the pre-stretch.

    Parameters
    ----------
    times : (N,) ascending [s].
    tolerance : error of the stretch relative to its range.
    limit : (W,) stretch at which a draw ends.
    mass : rho L^2/3 of (14), (W,); None without inertia.
    """
    walkers = material.modulus.size
    constants, units = material.constants(history, tolerance, limit)
    found = Motion(
        np.empty((walkers, times.size)), np.empty(walkers, dtype=np.int64), np.empty(walkers)
    )
    results = found.stretch, found.steps, found.ended
    pieces = history.edges, history.coefficients, history.restart
    if mass is None:
        from deabayes.systems.membrane_lanes import integrate

        integrate(*pieces, times, constants, units, *results)
    else:
        from deabayes.systems.membrane_inertia import integrate_with_inertia

        integrate_with_inertia(*pieces, times, constants, units, mass, *results)
    return found
