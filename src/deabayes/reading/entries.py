"""A quantity as specimen.yaml states it, in SI."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deabayes.experiment import Quantity
from deabayes.faults import UserError
from deabayes.units import si_unit, to_si


def stated_quantity(entry: Mapping[str, Any], unit: str | None, where: str) -> Quantity:
    """An entry with `value`, `unit` and perhaps `sd`, in `unit`, or where that is None in SI."""
    written = str(entry["unit"])
    unit = unit or si_unit(written, where)
    value = float(to_si(entry["value"], written, unit, where))
    sd = None if entry.get("sd") is None else float(to_si(entry["sd"], written, unit, where))
    if sd is not None and not 0.0 < sd < float("inf"):
        raise UserError(f"{where}.sd: must be a positive number, found {entry['sd']}; correct it, "
                        "or leave it out where the value is exact")  # fmt: skip
    return Quantity(value, unit, sd, str(entry.get("source", "")))
