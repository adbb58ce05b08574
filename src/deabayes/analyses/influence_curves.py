"""Curves from the prior as data sets: drawn, one parameter moved at a time, loops of the latter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.analyses.cycle_influence import cycle_numbers, loops, over_cycles
from deabayes.prediction.influence import QUANTILES, Curves, PriorModel, one_at_a_time

if TYPE_CHECKING:
    import xarray as xr

HELD = ("step", "creep", "relaxation")
"""Protocols of an excitation that goes to a level and stays."""
SHOWN = 20
"""Of the draws: those whose curves are kept."""
BAND = (0.05, 0.25, 0.5, 0.75, 0.95)


def prior_dataset(model: PriorModel, drawn: Curves) -> xr.Dataset:
    """The first draws' curves, quantiles of all that have one, and every draw's parameters."""
    kept = drawn.response[~drawn.failed]
    band = np.quantile(kept, BAND, axis=0) if len(kept) else np.full((5, kept.shape[1]), np.nan)
    names = list(model.names)
    return _dataset(model).assign(
        curve=(("shown", "coordinate"), drawn.response[:SHOWN]),
        band=(("quantile", "coordinate"), band),
        failed=("draw", drawn.failed),
        parameters=(("draw", "parameter"), np.stack([drawn.draws[n] for n in names], axis=1)),
    ).assign_coords(quantile=list(BAND), parameter=names)  # fmt: skip


def moved_dataset(model: PriorModel, moved: Mapping[str, Curves]) -> xr.Dataset:
    """A curve per parameter and quantile, NaN where it failed, and the values moved to."""
    responses = np.stack([curves.response for curves in moved.values()])
    curve = {"curve": (("parameter", "quantile", "coordinate"), responses)}
    return _dataset(model).assign(curve).merge(_moved(model, moved))


def loops_dataset(model: PriorModel) -> xr.Dataset:
    """Loops of the first and the last whole cycle per parameter and quantile, NaN where it failed.

    Beside them, the mean of the response over the cycle and the loop's area.
    """
    import xarray as xr

    record = model.experiment
    moved = one_at_a_time(over_cycles(model))
    found = loops(record, np.stack([curves.response for curves in moved.values()]))
    cycle, each = ("cycle", "phase"), ("parameter", "quantile", "cycle")
    return xr.Dataset(
        {
            "excitation": (cycle, found.voltage),
            "curve": ((*each, "phase"), found.displacement),
            "mean": (each, found.mean),
            "area": (each, found.area),
        },
        {"cycle": list(cycle_numbers(record))},
        _attributes(model),
    ).merge(_moved(model, moved))


def _moved(model: PriorModel, moved: Mapping[str, Curves]) -> xr.Dataset:
    """The values moved to, with the parameters' symbols and units."""
    import xarray as xr

    names = list(moved)
    known = {p.name: p for p in model.system.parameters()}
    return xr.Dataset(
        {"value": (("parameter", "quantile"), np.stack([moved[n].draws[n] for n in names]))},
        {
            "quantile": list(QUANTILES),
            "parameter": names,
            "symbol": ("parameter", [known[n].symbol for n in names]),
            "unit": ("parameter", [known[n].unit for n in names]),
        },
    )


def _dataset(model: PriorModel) -> xr.Dataset:
    """What a figure needs to know of the record."""
    import xarray as xr

    record = model.experiment
    return xr.Dataset(
        {
            "observed": ("time", record.response),
            "excitation": ("coordinate", record.excitation.at(model.coordinate)),
        },
        {"coordinate": model.coordinate, "time": record.coordinate},
        _attributes(model),
    )


def _attributes(model: PriorModel) -> dict[str, Any]:
    record = model.experiment
    return {
        "candidate": model.system.candidate,
        "experiment": record.name,
        "protocol": record.protocol,
        "held": int(record.protocol in HELD),
        "onset": record.excitation.onset,
        "response_name": record.response_name,
        "response_unit": record.response_unit,
        "excitation_name": record.excitation.name,
        "excitation_unit": record.excitation.unit,
    }
