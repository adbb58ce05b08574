"""A drive that is given as arrays in Python, checked: what `simulate` and `predict` follow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import Excitation, FloatArray
from deabayes.faults import UserError, nearest
from deabayes.given_values import array_in_si
from deabayes.systems.base import System


def excitation_of(
    system: System,
    time: ArrayLike | None,
    channels: Mapping[str, ArrayLike],
    conditions: Mapping[str, float | str],
) -> tuple[Excitation, str]:
    """The excitation, and what its coordinate is: `time`, or the channel itself without one.

    A single value (no array of one) is held over the time.

    Raises
    ------
    UserError
        Unknown or more than one channel, a drive in time without time or one without time with
        it, values that are no finite numbers, a coordinate that does not ascend or is empty, a
        frequency that is not positive, unknown conditions.
    """
    if not isinstance(conditions, Mapping):
        found = repr(conditions)
        raise UserError(f"conditions: give names with values, as {{'load_g': 300}}; found {found}")
    system.check_conditions(conditions)
    known = system.excitations
    for name in channels:
        if name not in known:
            raise UserError(
                f"excitation {name!r} is unknown for system {system.name!r}{nearest(name, known)}"
            )
    if len(channels) != 1:
        found = " and ".join(channels) or "none"
        raise UserError(f"give exactly one excitation of {', '.join(known)}; found {found}")
    name, given = next(iter(channels.items()))
    if time is None and name in system.in_time:
        raise UserError(f"{name} drives system {system.name!r} in time; give time= [s] as well")
    if time is not None and name in system.without_time:
        raise UserError(
            f"{name} drives system {system.name!r} from one steady state to the next, at no time; "
            f"leave time out and give an ascending {name}"
        )
    values = _finite(given, known[name], name)
    label = name if time is None else "time"
    coordinate = np.atleast_1d(values if time is None else _finite(time, "s", "time"))
    values = np.full(coordinate.shape, values) if values.ndim == 0 else values
    if coordinate.ndim != 1 or coordinate.shape != values.shape:
        raise UserError(f"{label} {coordinate.shape} and {name} {values.shape} differ in length")
    _check_coordinate(coordinate, label)
    driven = Excitation(name, known[name], coordinate, values, conditions, time is not None)
    return driven, label


def _check_coordinate(coordinate: FloatArray, label: str) -> None:
    if coordinate.size == 0:
        raise UserError(f"{label} holds no values; give one at least")
    back = np.flatnonzero(np.diff(coordinate) <= 0.0)
    if back.size:
        raise UserError(f"{label} must ascend; it does not at index {back[0] + 1}")
    if label == "frequency" and coordinate[0] <= 0.0:
        raise UserError(f"frequency must be positive, found {coordinate[0]:g} Hz at index 0")


def _finite(given: ArrayLike, unit: str, name: str) -> FloatArray:
    values = array_in_si(given, unit, name)
    bad = np.argwhere(~np.isfinite(np.atleast_1d(values)))
    if bad.size:
        where = ", ".join(map(str, bad[0]))
        found = np.atleast_1d(values)[tuple(bad[0])]
        raise UserError(f"{name} must be finite, found {found} at index {where}")
    return values
