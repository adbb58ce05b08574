"""Checks of the voltage that a record holds against what its row says.

They return sentences as those in `checks` do.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit
from deabayes.reading.checks import not_finite
from deabayes.reading.held import is_held

STATED = ("voltage_kV", "amplitude_kV", "bias_kV")
UNIT_FACTOR = 30.0
"""Voltages apart by more than this are in different units; kV and V are 1000 apart."""


def unknown_voltage(columns: Collection[str], metadata: Collection[str], where: str) -> list[str]:
    """A pull on an actuator that does not say at which voltage."""
    if "voltage" in columns or "voltage_kV" in metadata:
        return []
    return [
        f"{where}: the voltage during the pull is not known; give a column 'voltage [kV]', or "
        "voltage_kV in experiments.csv (0 without voltage)"
    ]


def voltage_not_held(voltage: FloatArray, where: str) -> list[str]:
    """A voltage [V] that varies during a pull by more than 1 % of it or a monitor's noise."""
    faults = not_finite(voltage, "voltage", where)
    if faults or is_held(voltage):
        return faults
    return [
        f"{where}, column voltage: varies from {voltage.min():g} to {voltage.max():g} V during the "
        "pull; give one record per voltage"
    ]


def voltage_no_number(stated: float | str, where: str) -> list[str]:
    """A voltage in experiments.csv that is none."""
    if not isinstance(stated, str) and np.isfinite(stated):
        return []
    return [
        f"{where}: voltage_kV is {stated!r} in experiments.csv; give a number in kV (0 without "
        "voltage), or a column 'voltage [kV]' in the record"
    ]


def voltage_in_another_unit(
    size: float, column: str, stated: float | str | None, where: str
) -> list[str]:
    """The `size` [V] of a record's voltage against what `column` of experiments.csv says [kV]."""
    if not isinstance(stated, float) or not stated > 0.0 or np.isnan(size):
        return []
    if 1.0 / UNIT_FACTOR <= size / (1000.0 * stated) <= UNIT_FACTOR:
        return []
    return [
        f"{where}, column voltage: comes to {size:g} V where experiments.csv says {column} "
        f"{stated:g}; correct the column's unit, or {column}"
    ]


def stated_beyond_range(metadata: Mapping[str, float | str], limit: float, where: str) -> list[str]:
    """Voltages in experiments.csv [kV] beyond what the amplifier can give, `limit` [V]."""
    stated = {name: metadata.get(name) for name in STATED}
    return [
        f"{where}: {name} is {value:g} in experiments.csv, beyond the voltage's range of "
        f"{with_unit(limit, 'V')} in specimen.yaml; give it in kV, or correct the range"
        for name, value in stated.items()
        if isinstance(value, float) and 1000.0 * abs(value) > limit * (1.0 + 1e-9)
    ]
