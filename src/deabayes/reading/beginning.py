"""What an excitation is taken to have been before the first sample of its record."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.reading.columns import COMMANDS
from deabayes.reading.raw import ExperimentRow
from deabayes.systems import system_class

NEAR = 0.02
"""Of the largest excitation: less is a monitor's offset, no jump at the first sample."""


def knows_prehistory(system: str, excitation: str) -> bool:
    """Whether experiments.csv can say that a system had settled under the first excitation."""
    try:
        conditions = system_class(system).conditions or {}
    except UserError:  # the system's name is at fault, which is said elsewhere
        return False
    return "prehistory" in conditions.get(COMMANDS.get(excitation, excitation), {})


def value_before(row: ExperimentRow, system: str) -> float | None:
    """0 of a voltage, which was off; None where the excitation was as in its first sample.

    That is so of a stretch, and of a voltage where the row says so.
    """
    if COMMANDS.get(row.excitation, row.excitation) != "voltage":
        return None
    settled = row.metadata.get("prehistory") == "equilibrium"
    return None if settled and knows_prehistory(system, row.excitation) else 0.0


def is_near(first: float, before: float, excitation: FloatArray) -> bool:
    """Whether a first sample is hardly off the value before it, as the whole excitation goes."""
    return abs(first - before) <= NEAR * float(np.max(np.abs(excitation - before)))
