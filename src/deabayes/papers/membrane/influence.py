"""Influence of each parameter on the prior response (Nguyen et al. 2021, Figs. 7, 8, 10)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers.base import Analysis, Row, StudyContext, band
from deabayes.papers.timing import PHASES, Cycles, Loops
from deabayes.prediction import influence
from deabayes.prediction.influence import QUANTILES, Curves, PriorModel, Sensitivity, Stages

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
FEWEST = 2
"""Smallest number of whole cycles; creep shows between the first and the last."""
FIRST, LAST = 0, -1
CONSTANT = ("step", "creep", "relaxation")
"""Protocols in which the excitation goes to a level and stays there."""
SHOWN = 20
"""Number of draws whose curves are kept."""


def compute(context: StudyContext) -> Analysis:
    """Return curves of the strongest record per protocol, and indices of the extreme records."""
    rng = context.rng("influence")
    records = of_calibrated_response(context.experiments)
    curves: dict[str, xr.Dataset] = {}
    failed_draws: list[Row] = []
    failed: list[Row] = []
    sobol: list[Row] = []
    for candidate in context.candidates:
        system, prior = context.system_of(candidate), context.prior_of(candidate)
        for record in strongest(records):
            model = PriorModel(system, prior, record, curve_times(record))
            drawn = influence.prior_curves(model, DRAWS, rng)
            curves |= curves_of(model, drawn)
            failed_draws.append(failed_row(model, "prior", DRAWS, causes(model, drawn)))
            failed += failed_parameters(model, drawn)
        for record in extremes(records):
            model = PriorModel(system, prior, record)
            for sensitivity in (
                influence.stage_sensitivity(model, stages_of(record), GROUPS, rng),
                influence.failure_sensitivity(model, GROUPS, rng),
            ):
                central = f"central {100 * sensitivity.region:.0f} %"
                source = f"Sobol' points, {'whole prior' if sensitivity.region == 1.0 else central}"
                failed_draws.append(
                    failed_row(model, source, sensitivity.runs, {"": sensitivity.failed})
                )
                sobol += sobol_rows(model, sensitivity)
    tables = {"failed_draws": failed_draws, "failed_parameters": failed, "sobol": sobol}
    return Analysis.of_rows(tables, curves)


def of_calibrated_response(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Records with the response of the first calibration record; all if there is none."""
    first = next((e.response_name for e in experiments if e.role == "calibrate"), None)
    return [e for e in experiments if first in (None, e.response_name)]


def strongest(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Record of each protocol with the largest peak excitation; the shortest of equal ones."""
    protocols = dict.fromkeys(e.protocol for e in experiments)
    return [max((e for e in experiments if e.protocol == p), key=_strength) for p in protocols]


def extremes(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Weakest and strongest record with a constant excitation, and two sines.

    The sines are the slowest and the fastest of those with the largest peak.
    """
    constant = sorted((e for e in experiments if e.protocol in CONSTANT), key=_strength)
    sines = [e for e in experiments if has_cycles(e)]
    peak = max((_strength(e)[0] for e in sines), default=0.0)
    sines = [e for e in sines if _strength(e)[0] == peak]
    sines.sort(key=lambda e: Cycles.of(e).frequency)
    ends = [group if len(group) < 2 else [group[0], group[-1]] for group in (constant, sines)]
    return ends[0] + ends[1]


def _strength(experiment: Experiment) -> tuple[float, float]:
    """Sort key: the peak to two digits, which monitor noise does not change, then brevity."""
    peak = float(f"{np.abs(experiment.excitation.values).max():.2g}")
    return peak, -float(np.ptp(experiment.coordinate))


def has_cycles(record: Experiment) -> bool:
    """Whether the record is a sine with enough whole cycles."""
    return record.protocol == "sine" and Cycles.of(record).starts.size >= FEWEST


def curve_times(record: Experiment) -> FloatArray:
    """Times of smooth curves: even in logarithmic time after a step, else even in time."""
    start, end = record.excitation.onset, float(record.coordinate.max())
    if record.protocol in CONSTANT:
        return start + np.geomspace(EARLIEST * (end - start), end - start, POINTS)
    return np.linspace(start, end, POINTS_IN_TIME)


def stages_of(record: Experiment) -> Stages:
    """Stages of the Sobol' indices: changes by times after a step, or cycles of a sine."""
    if record.protocol in CONSTANT:
        return partial(influence.stage_changes, times=influence.stage_times(record))
    return cycle_stages


def cycle_stages(model: PriorModel, z: FloatArray) -> dict[str, FloatArray]:
    """Amplitude of the first and last whole cycle, creep between them, loop area; (W,) each."""
    model = over_cycles(model)
    loops = loops_of(model.experiment, model.response(model.parameters(z)))
    first, last = loops.numbers
    mean, size = loops.mean, loops.peak_to_peak
    return {
        f"peak to peak, cycle {first}": size[:, FIRST],
        f"peak to peak, cycle {last}": size[:, LAST],
        f"drift of the mean, {first} to {last}": mean[:, LAST] - mean[:, FIRST],
        f"loop area, cycle {last}": loops.area[:, LAST],
    }


def over_cycles(model: PriorModel) -> PriorModel:
    """Return the model with its response at even phases of the first and last whole cycle."""
    return replace(model, at=_times(model.experiment).ravel())


def loops_of(record: Experiment, response: FloatArray) -> Loops:
    """Loops of the two cycles, from responses (..., N) of a model `over_cycles`."""
    times = _times(record)
    moved = response.reshape(*response.shape[:-1], *times.shape)
    return Loops(moved, record.excitation.at(times), Cycles.of(record).numbers[[FIRST, LAST]])


def _times(record: Experiment) -> FloatArray:
    return Cycles.of(record).times(PHASES)[[FIRST, LAST]]


def curves_of(model: PriorModel, drawn: Curves) -> dict[str, xr.Dataset]:
    """Data sets of a record, by name: curves of the prior, of moved parameters, and loops."""
    which = f"{model.system.candidate}_{model.experiment.name}"
    moved = influence.one_at_a_time(model)
    curve = ("parameter", "quantile", "coordinate"), _responses(moved)
    curves = {
        f"prior_{which}": prior_dataset(model, drawn),
        f"one_at_a_time_{which}": _dataset(model).assign(curve=curve).merge(_values(model, moved)),
    }
    if has_cycles(model.experiment):
        curves[f"loops_{which}"] = loops_dataset(model)
    return curves


def prior_dataset(model: PriorModel, drawn: Curves) -> xr.Dataset:
    """Data set of the first draws' curves, quantiles of all curves, and all parameters."""
    finite = drawn.response[~drawn.failed]
    size = (len(QUANTILES), drawn.response.shape[1])
    quantiles = np.quantile(finite, QUANTILES, axis=0) if len(finite) else np.full(size, np.nan)
    names = list(model.names)
    return _dataset(model).assign(
        curve=(("shown", "coordinate"), drawn.response[:SHOWN]),
        band=(("quantile", "coordinate"), quantiles),
        failed=("draw", drawn.failed),
        parameters=(("draw", "parameter"), np.stack([drawn.draws[n] for n in names], axis=1)),
    ).assign_coords(quantile=list(QUANTILES), parameter=names)  # fmt: skip


def loops_dataset(model: PriorModel) -> xr.Dataset:
    """Data set of the loops of the first and last whole cycle, per parameter and quantile.

    It also holds the mean response over the cycle and the loop's area. Failed curves are NaN.
    """
    moved = influence.one_at_a_time(over_cycles(model))
    loops = loops_of(model.experiment, _responses(moved))
    cycle, each = ("cycle", "phase"), ("parameter", "quantile", "cycle")
    content = {
        "excitation": (cycle, loops.voltage),
        "curve": ((*each, "phase"), loops.displacement),
        "mean": (each, loops.mean),
        "area": (each, loops.area),
    }
    coords = {"cycle": loops.numbers}
    return xr.Dataset(content, coords, _attributes(model)).merge(_values(model, moved))


def _responses(moved: Mapping[str, Curves]) -> FloatArray:
    """Responses (parameter, quantile, N); NaN if failed."""
    return np.stack([curves.response for curves in moved.values()])


def _values(model: PriorModel, moved: Mapping[str, Curves]) -> xr.Dataset:
    """Data set of the values of each parameter at its quantiles, with symbols and units."""
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
    record = model.experiment
    excitation = ("coordinate", record.excitation.at(model.coordinate))
    return xr.Dataset(
        {"observed": ("time", record.response), "excitation": excitation},
        {"coordinate": model.coordinate, "time": record.coordinate},
        _attributes(model),
    )


def _attributes(model: PriorModel) -> dict[str, object]:
    record = model.experiment
    return {
        "candidate": model.system.candidate,
        "experiment": record.name,
        "protocol": record.protocol,
        "held": int(record.protocol in CONSTANT),
        "onset": record.excitation.onset,
        "response_name": record.response_name,
        "response_unit": record.response_unit,
        "excitation_name": record.excitation.name,
        "excitation_unit": record.excitation.unit,
    }


def sobol_rows(model: PriorModel, sensitivity: Sensitivity) -> Iterator[Row]:
    """Rows of Sobol' indices, one per stage and parameter; none of failures that are too rare."""
    if sensitivity.region == 1.0 and sensitivity.failed < FEWEST_FAILED_SHARE * sensitivity.runs:
        return
    symbols = {p.name: p.symbol for p in model.system.parameters()}
    for stage, indices in sensitivity.by_stage.items():
        for k, name in enumerate(model.names):
            yield {
                **_first(model),
                "stage": stage,
                "parameter": name,
                "symbol": symbols[name],
                "first_order": indices.first_order[k],
                "first_order_conf": indices.first_order_conf[k],
                "total": indices.total[k],
                "total_conf": indices.total_conf[k],
                "region_percent": 100 * sensitivity.region,
                "groups": indices.groups,
                "groups_left_out": indices.left_out,
            }


def causes(model: PriorModel, drawn: Curves) -> Counter[str]:
    """Number of failed draws by cause."""
    failed = {name: values[drawn.failed] for name, values in drawn.draws.items()}
    return Counter(str(word) for word in model.system.why_failed(failed))


def failed_row(model: PriorModel, source: str, draws: int, counts: Mapping[str, int]) -> Row:
    """Row of the number of failed draws, and how many failed from which cause."""
    total = sum(counts.values())
    words = [f"{word} {count}" for word, count in counts.items() if word]
    return {
        **_first(model),
        "drawn_from": source,
        "draws": draws,
        "failed": total,
        "share_percent": 100 * total / draws,
        "what_failed": ", ".join(words) or "–",
    }


def failed_parameters(model: PriorModel, drawn: Curves) -> Iterator[Row]:
    """Rows of each parameter's quantiles (SI) among failed draws and among the others."""
    failed = drawn.failed
    if failed.sum() < FEWEST_FAILED_SHARE * failed.size or failed.all():
        return
    for parameter in model.system.parameters():
        values = drawn.draws[parameter.name]
        row: Row = {**_first(model), "parameter": parameter.name, "unit": parameter.unit}
        for name, part in (("failed", failed), ("others", ~failed)):
            low, median, high = band(values[part])
            row |= {name: median, f"{name}_q05": low, f"{name}_q95": high}
        below = np.mean(values[failed][:, None] < values[~failed])
        yield row | {"share_lower_percent": 100 * below}


def _first(model: PriorModel) -> Row:
    return {"candidate": model.system.candidate, "record": model.experiment.name}
