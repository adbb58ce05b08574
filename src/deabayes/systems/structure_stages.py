"""The minimum-energy structure's step: Rodas5P's stages for its blocks, in lanes.

The units of a stage come first, because theta's needs the force that they make up (see
`structure_kernel` for the equations and the rows, `integrate.arrow` for the scheme).
"""

from __future__ import annotations

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate.arrow import LANES
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import structure_angle_stages as of_angle
from deabayes.systems import structure_kernel as k
from deabayes.systems import structure_unit_stages as of_unit
from deabayes.systems.structure_kernel import ALLOWED, ERROR, FACTOR


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray, dry: bool) -> None:
    """One step of every lane: the block of theta and omega, those of the `units` (n, ...)."""
    n = units.shape[0]
    k.drive(c)
    k.begin(c)
    for u in range(n):
        of_unit.unit_1(units[u], c)
    of_angle.angle_1(c, dry)
    for u in range(n):
        of_unit.unit_2(units[u], c)
    of_angle.angle_2(c, dry)
    for u in range(n):
        of_unit.unit_3(units[u], c)
    of_angle.angle_3(c, dry)
    for u in range(n):
        of_unit.unit_4(units[u], c)
    of_angle.angle_4(c, dry)
    for u in range(n):
        of_unit.unit_5(units[u], c)
    of_angle.angle_5(c, dry)
    for u in range(n):
        of_unit.unit_6(units[u], c)
    of_angle.angle_6(c, dry)
    for u in range(n):
        of_unit.unit_7(units[u], c)
    of_angle.angle_7(c, dry)
    for u in range(n):
        of_unit.unit_8(units[u], c)
    of_angle.angle_8(c, dry)
    for u in range(n):
        of_unit.unit_end(units[u], c)
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])
