"""Influence of each parameter on the prior response (Nguyen et al. 2021, Figs. 7, 8, 10)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers.base import Analysis, StudyContext
from deabayes.papers.timing import PHASES, Cycles, Loops
from deabayes.prediction import influence
from deabayes.prediction.influence import (
    QUANTILES,
    Curves,
    PriorModel,
    Sensitivity,
    Stages,
    one_at_a_time,
)

if TYPE_CHECKING:
    import xarray as xr

FEWEST = 2
"""Smallest number of whole cycles; creep shows between the first and the last."""
FIRST, LAST = 0, -1


def has_cycles(record: Experiment) -> bool:
    """Whether the record is a sine with enough whole cycles."""
    return record.protocol == "sine" and Cycles.of(record).starts.size >= FEWEST


def cycle_numbers(record: Experiment) -> tuple[int, int]:
    """Numbers of the first and the last whole cycle, counted from 1."""
    first, last = Cycles.of(record).numbers[[FIRST, LAST]].tolist()
    return first, last


def over_cycles(model: PriorModel) -> PriorModel:
    """Return the model with its response at even phases of the first and last whole cycle."""
    return replace(model, at=_times(model.experiment).ravel())


def loops(record: Experiment, response: FloatArray) -> Loops:
    """Loops of the two cycles, from responses (..., N) of a model `over_cycles`."""
    times = _times(record)
    shape = *response.shape[:-1], *times.shape
    return Loops(response.reshape(shape), record.excitation.at(times))


def cycle_stages(model: PriorModel, z: FloatArray) -> dict[str, FloatArray]:
    """Amplitude of the first and last whole cycle, creep between them, loop area; (W,) each."""
    found = loops(model.experiment, over_cycles(model).response(model.parameters(z)))
    first, last = cycle_numbers(model.experiment)
    mean, size = found.mean, found.peak_to_peak
    return {
        f"peak to peak, cycle {first}": size[:, FIRST],
        f"peak to peak, cycle {last}": size[:, LAST],
        f"drift of the mean, {first} to {last}": mean[:, LAST] - mean[:, FIRST],
        f"loop area, cycle {last}": found.area[:, LAST],
    }


def _times(record: Experiment) -> FloatArray:
    return Cycles.of(record).times(PHASES)[[FIRST, LAST]]


HELD = ("step", "creep", "relaxation")
"""Protocols in which the excitation goes to a level and stays there."""
SHOWN = 20
"""Number of draws whose curves are kept."""
BAND = (0.05, 0.25, 0.5, 0.75, 0.95)


def prior_dataset(model: PriorModel, drawn: Curves) -> xr.Dataset:
    """Data set of the first draws' curves, quantiles of all curves, and all parameters."""
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
    """Data set of one curve per parameter and quantile (NaN if failed), and their values."""
    responses = np.stack([curves.response for curves in moved.values()])
    curve = {"curve": (("parameter", "quantile", "coordinate"), responses)}
    return _dataset(model).assign(curve).merge(_moved(model, moved))


def loops_dataset(model: PriorModel) -> xr.Dataset:
    """Data set of the loops of the first and last whole cycle, per parameter and quantile.

    It also holds the mean response over the cycle and the loop's area. Failed curves are NaN.
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
    """Data set of the values of each parameter at its quantiles, with symbols and units."""
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
    """Data set of the record's response and excitation, for the figures."""
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


SYSTEMS = ("membrane",)
TITLE = "What the parameters do to the response"
CAPTION = (
    "From the prior alone, no data used. Draws that fail have no response: they are counted, and "
    "bands and indices are of the others. Sobol' indices are over a central region of the prior in "
    "which at most 1 % of the groups of model runs fail, so the regions of records differ; they, "
    "with 95 % intervals, are in the report's tables folder (sobol). Of ordered time constants, "
    "those of a later member are what it adds once the earlier ones are known. "
    "Share lower: probability that the parameter of a failed draw lies below that of a draw that "
    "has a response; 50 % where the parameter has no say."
)
DRAWS = 1000
POINTS, POINTS_IN_TIME, EARLIEST = 120, 601, 1e-4
GROUPS = 4096
"""Groups of model runs; with 1024 the membrane's intervals are twice as wide in the figure."""
FEWEST_FAILED_SHARE = 0.01
"""Smallest share of failures that is analysed; indices of rarer failures would be noise."""
Row = dict[str, Any]


def compute(context: StudyContext) -> Analysis:
    """Return curves of the strongest record per protocol, and indices of the extreme records."""
    import pandas as pd

    rng = context.rng("influence")
    records = of_calibrated_response(context.experiments)
    curves: dict[str, xr.Dataset] = {}
    rows: dict[str, list[Row]] = {"failed_draws": [], "failed_parameters": [], "sobol": []}
    for candidate in context.candidates:
        system, prior = context.system_of(candidate), context.prior_of(candidate)
        for record in strongest(records):
            _draw_curves(PriorModel(system, prior, record, curve_times(record)), rng, curves, rows)
        for record in extremes(records):
            _ask_who_decides(PriorModel(system, prior, record), rng, rows)
    tables = {name: pd.DataFrame(found) for name, found in rows.items() if found}
    return Analysis(tables, curves)


def _draw_curves(
    model: PriorModel,
    rng: np.random.Generator,
    curves: dict[str, xr.Dataset],
    rows: dict[str, list[Row]],
) -> None:
    which = f"{model.system.candidate}_{model.experiment.name}"
    drawn = influence.prior_curves(model, DRAWS, rng)
    curves[f"prior_{which}"] = prior_dataset(model, drawn)
    curves[f"one_at_a_time_{which}"] = moved_dataset(model, influence.one_at_a_time(model))
    if has_cycles(model.experiment):
        curves[f"loops_{which}"] = loops_dataset(model)
    rows["failed_draws"].append(_failed_row(model, "prior", drawn.failed.size, _why(model, drawn)))
    rows["failed_parameters"] += failed_parameters(model, drawn)


def _ask_who_decides(
    model: PriorModel, rng: np.random.Generator, rows: dict[str, list[Row]]
) -> None:
    """Add rows of Sobol' indices for the stages, and for failure if it is not too rare."""
    for found in (
        influence.stage_sensitivity(model, stages_of(model.experiment), GROUPS, rng),
        influence.failure_sensitivity(model, GROUPS, rng),
    ):
        region = "whole prior" if found.region == 1.0 else f"central {100 * found.region:.0f} %"
        where = f"Sobol' points, {region}"
        rows["failed_draws"].append(_failed_row(model, where, found.runs, {"": found.failed}))
        if found.region < 1.0 or found.failed >= FEWEST_FAILED_SHARE * found.runs:
            rows["sobol"] += sobol_rows(model, found)


def of_calibrated_response(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Records with the response of the first calibration record; all if there is none."""
    first = next((e.response_name for e in experiments if e.role == "calibrate"), None)
    return [e for e in experiments if first in (None, e.response_name)]


def strongest(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Record of each protocol with the largest peak excitation; the shortest of equal ones."""
    best: dict[str, Experiment] = {}
    for each in experiments:
        kept = best.get(each.protocol)
        if kept is None or _strength(each) > _strength(kept):
            best[each.protocol] = each
    return list(best.values())


def extremes(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Weakest and strongest record with a held excitation, and two sines.

    The sines are the slowest and the fastest of those with the largest peak.
    """
    held = sorted((e for e in experiments if e.protocol in HELD), key=_strength)
    sines = [e for e in experiments if has_cycles(e)]
    peak = max((_strength(e)[0] for e in sines), default=0.0)
    driven = sorted((e for e in sines if _strength(e)[0] == peak), key=_frequency)
    return [*_ends(held), *_ends(driven)]


def stages_of(record: Experiment) -> Stages:
    """Stages of the Sobol' indices: changes by times after a step, or cycles of a sine."""
    if record.protocol in HELD:
        return partial(influence.stage_changes, times=influence.stage_times(record))
    return cycle_stages


def curve_times(record: Experiment) -> FloatArray:
    """Times of smooth curves: even in logarithmic time after a step, else even in time."""
    start, end = record.excitation.onset, float(record.coordinate.max())
    if record.protocol in HELD:
        return start + np.geomspace(EARLIEST * (end - start), end - start, POINTS)
    return np.linspace(start, end, POINTS_IN_TIME)


def _strength(experiment: Experiment) -> tuple[float, float]:
    """Sort key: the peak to two digits, which monitor noise does not change, then brevity."""
    peak = float(f"{np.abs(experiment.excitation.values).max():.2g}")
    return peak, -float(np.ptp(experiment.coordinate))


def _frequency(sine: Experiment) -> float:
    return Cycles.of(sine).frequency


def _ends(records: Sequence[Experiment]) -> list[Experiment]:
    return [records[0], records[-1]] if len(records) > 1 else list(records)


def sobol_rows(model: PriorModel, found: Sensitivity) -> list[Row]:
    """Rows of Sobol' indices, one per stage and parameter."""
    symbols = {p.name: p.symbol for p in model.system.parameters()}
    return [
        {
            "candidate": model.system.candidate,
            "record": model.experiment.name,
            "stage": stage,
            "parameter": name,
            "symbol": symbols[name],
            "first_order": indices.first_order[k],
            "first_order_conf": indices.first_order_conf[k],
            "total": indices.total[k],
            "total_conf": indices.total_conf[k],
            "region_percent": 100 * found.region,
            "groups": indices.groups,
            "groups_left_out": indices.left_out,
        }
        for stage, indices in found.by_stage.items()
        for k, name in enumerate(model.names)
    ]


def _why(model: PriorModel, drawn: Curves) -> Counter[str]:
    lost = {name: values[drawn.failed] for name, values in drawn.draws.items()}
    return Counter(str(word) for word in model.system.why_failed(lost))


def _failed_row(model: PriorModel, where: str, draws: int, why: Mapping[str, int]) -> Row:
    total = sum(why.values())
    words = [f"{word} {count}" for word, count in why.items() if word]
    return {
        "candidate": model.system.candidate,
        "record": model.experiment.name,
        "drawn_from": where,
        "draws": draws,
        "failed": total,
        "share_percent": 100 * total / draws,
        "what_failed": ", ".join(words) or "–",
    }


def failed_parameters(model: PriorModel, drawn: Curves) -> list[Row]:
    """Rows of each parameter's quantiles (SI) among failed draws and among the others."""
    lost = drawn.failed
    if lost.sum() < FEWEST_FAILED_SHARE * lost.size or lost.all():
        return []
    rows = []
    for parameter in model.system.parameters():
        values = drawn.draws[parameter.name]
        row: Row = {
            "candidate": model.system.candidate,
            "record": model.experiment.name,
            "parameter": parameter.name,
            "unit": parameter.unit,
        }
        for name, part in (("failed", lost), ("others", ~lost)):
            low, median, high = np.quantile(values[part], [0.05, 0.5, 0.95])
            row |= {name: median, f"{name}_q05": low, f"{name}_q95": high}
        below = np.mean(values[lost][:, None] < values[~lost])
        rows.append(row | {"share_lower_percent": 100 * below})
    return rows
