"""Default preparation steps, and checks for steps without effect or with a wrong target."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deabayes.experiment import PHASE, Experiment
from deabayes.faults import UserError, nearest
from deabayes.integrate.periodic import passes
from deabayes.records.channels import STEPS, usual_interval
from deabayes.records.columns import ExperimentRow
from deabayes.records.preparation.average import (
    LONGEST_GRID,
    NOTED,
    Ringing,
    harmonics,
    ringing,
    width_for,
)
from deabayes.records.preparation.cycles import found_period, whole_cycles
from deabayes.records.preparation.working import WorkingRecord
from deabayes.systems.specimen_quantities import instrument

POINTS = 400
TRANSITION, PER_CYCLE, FEWEST_PER_CYCLE = 5, 40, 20
"""For the step `cycles`: its defaults, and the fewest bins per cycle that hardly flatten a sine."""
MANY_SAMPLES, FINE = 20_000, 1e-4
"""An excitation with more samples is described by knots, within the share `FINE` of its range.
Lines between knots lie inside a sine, so its amplitude comes out too small by that share."""


def sine_steps(record: WorkingRecord) -> list[Step]:
    """Choose uniform bins for few cycles, the step `cycles` for many, else thinned narrow bins.

    The bin width takes at most 0.1 % off the amplitude of the highest strong harmonic of the
    response (for a voltage: an eightieth of a period). 400 such bins hold five cycles. The step
    `cycles` needs regular cycles with at least 40 samples each. Other records keep every n-th of
    these bins, or of their samples, so that about 400 points remain.
    """
    many = record.excitation.size > MANY_SAMPLES
    knots: list[Step] = [{"excitation_knots": {"fraction": FINE}}] if many else []
    visible = record.coordinate[record.used]
    span, interval = float(np.ptp(visible)), usual_interval(visible)
    times = passes(record.excitation_coordinate, record.excitation)
    period = float(np.diff(times).min()) if times.size > 1 else span
    width = width_for(0.2 * NOTED, harmonics(record) / period)
    if span <= POINTS * width:
        return [*knots, {"average": {"grid": "uniform", "points": POINTS}}]
    per_cycle = _bins_per_cycle(record, interval)
    if per_cycle >= FEWEST_PER_CYCLE:
        points = {} if per_cycle == PER_CYCLE else {"points": per_cycle}
        return [{"cycles": points}, *knots]
    return [*knots, *_thinned(span, interval, period, width)]


def _bins_per_cycle(record: WorkingRecord, interval: float) -> int:
    """Number of half-averaged bins that `cycles` can make per cycle; 0 if it refuses the record."""
    try:
        period = found_period(record, "")
        whole_cycles(record, period, TRANSITION, "")
    except UserError:
        return 0
    return min(PER_CYCLE, int(0.5 * period / interval * (1.0 + 1e-6)))


def _thinned(span: float, interval: float, period: float, width: float) -> list[Step]:
    steps: list[Step] = []
    if interval < width and span < LONGEST_GRID * width:
        steps.append({"average": {"grid": "uniform", "width": f"{width:.6g} s"}})
    else:
        width = interval
    least = span / width / POINTS
    if least > 1.0:
        steps.append({"decimate": {"every": _every(least, width / period)}})
    return steps


def _every(least: float, share: float) -> int:
    """Return n, to keep every n-th bin (bins are `share` of a period), with n close to `least`.

    The choice avoids phases that recur within four points where possible, and first those within
    two.
    """
    candidates = np.arange(max(int(0.75 * least), 1), int(np.ceil(least)) + 1)
    turns = candidates[:, None] * share * np.arange(1, 5)
    away = np.abs(turns - np.round(turns))
    return int(candidates[np.argmax(away.min(axis=1) + 0.01 * away[:, :2].min(axis=1))])


Step = Mapping[str, Mapping[str, object]]
WIDEST = 50.0
"""A record's length over the widest bins of `average`."""
MOST_THINNED = 5
"""Largest n where every n-th bin of a ringing record is kept: eight of forty bins in a period."""

DEFAULT_STEPS: Mapping[str, Sequence[Step]] = {
    "creep": ({"excitation_knots": {}}, {"average": {"grid": "geometric"}}),
    "step": ({"excitation_knots": {}}, {"average": {"grid": "geometric"}}),
    "relaxation": (
        {"mask_ramp_end": {}},
        {"excitation_knots": {}},
        {"average": {"grid": "geometric"}},
    ),
    "load_unload": ({"excitation_knots": {}}, {"average": {"grid": "uniform", "points": 180}}),
    "sweep": ({"excitation_knots": {}},),
    "quasi_static": (),
    "frequency_response": (),
}
"""Default steps by protocol. For a sine they depend on the record (`sine_steps`), and bins are
narrower if a step response rings. Default steps alter a response in two cases only: they undo
a delay that specimen.yaml states as exact, and subtract an offset that is seen at rest."""


def default_steps(record: WorkingRecord, offset: bool = False) -> list[Step]:
    """Return the default steps of a record.

    They first undo an exactly known sensor delay, then subtract an `offset` at rest.
    """
    protocol = record.row.protocol
    steps = list(DEFAULT_STEPS.get(protocol, ()))
    if protocol == "sine":
        steps = sine_steps(record)
    elif protocol in STEPS and (rings := ringing(record)) is not None:
        steps = _ringing_steps(record, rings)
    if offset:
        steps = [{"baseline": {}}, *steps]
    sensor = instrument(record.specimen, "delay", record.row.response, "s")
    delayed = record.coordinate_name in ("time", "frequency")
    known = sensor is not None and sensor.sd is None and delayed
    return [{"delay": {}}, *steps] if known else steps


def _ringing_steps(record: WorkingRecord, rings: Ringing) -> list[Step]:
    """Use bins of a fortieth of the ringing's period, unless the record is too long for them."""
    usual = list(DEFAULT_STEPS[record.row.protocol])
    span = float(np.ptp(record.coordinate))
    narrow = width_for(0.2 * NOTED, 1.0 / rings.period)
    every = int(np.ceil(span / narrow / POINTS))
    if narrow >= span / WIDEST or every > MOST_THINNED:
        return usual
    average: Step = {"average": {"grid": "geometric", "widest": f"{narrow:.4g} s"}}
    return [usual[0], average, *([{"decimate": {"every": every}}] if every > 1 else [])]


MASKS = ("mask_before", "mask_after", "mask_between")


def with_idle_masks(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Warn in a protocol's first experiment of masks that hide no sample of the protocol.

    A mask applies to all records of its protocol, and some records may end before it.
    """
    by_protocol: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        by_protocol.setdefault(experiment.protocol, []).append(experiment)
    idle = {own[0].name: tuple(_idle_masks(own)) for own in by_protocol.values()}
    return [
        replace(experiment, warnings=(*experiment.warnings, *idle.get(experiment.name, ())))
        for experiment in experiments
    ]


def _idle_masks(experiments: Sequence[Experiment]) -> Iterator[str]:
    """Yield a warning for each mask that hides no sample of these records of one protocol."""
    entries: Any
    for entries in zip(*(experiment.steps for experiment in experiments), strict=False):
        step, settings = entries[0]["step"], entries[0]["settings"]
        meant = [
            experiment
            for experiment in experiments
            if settings.get("record") in (None, experiment.name)
        ]
        if step in MASKS and meant and not any(entry["masked"] for entry in entries):
            given = ", ".join(f"{key}: {value}" for key, value in settings.items())
            yield (
                f"step {step} ({given}) hides no sample of {_extent(meant)}; correct its times or "
                "their unit, or remove it"
            )


def _extent(experiments: Sequence[Experiment]) -> str:
    """Name the records and the range of their points."""
    which = experiments[0].name if len(experiments) == 1 else f"any {experiments[0].protocol}"
    every = np.concatenate([experiment.coordinate for experiment in experiments])
    unit = experiments[0].coordinate_unit
    return f"{which} record, from {every.min():.4g} to {every.max():.4g} {unit}"


def misaddressed(
    preparation: Mapping[str, Sequence[Mapping[str, object] | str] | None],
    rows: Sequence[ExperimentRow],
) -> list[str]:
    """Return the faults of `record:` and `response:` settings of steps; empty if none.

    Parameters
    ----------
    preparation : protocol -> its steps, as in config.yaml.
    rows : all rows of experiments.csv, even those the study leaves out, because studies share
        steps.
    """
    faults = []
    for protocol, step, settings in _settings_of(preparation):
        own = [row for row in rows if row.protocol == protocol]
        known = {"record": {row.name for row in own}, "response": {row.response for row in own}}
        if "gain" in known["response"]:
            known["record"] |= {f"{name}{PHASE}" for name in known["record"]}
            known["response"].add("phase")
        faults += [
            f"preparation.{protocol}, {step}.{key}: "
            f"{_unknown(settings[key], key, protocol, sorted(names))}"
            for key, names in known.items()
            if own and settings.get(key) is not None and str(settings[key]) not in names
        ]
    return faults


def _unknown(given: object, key: str, protocol: str, known: Sequence[str]) -> str:
    if isinstance(given, list | tuple | Mapping):
        return f"expected one {key}, found {given!r}; write the step once for each"
    what = "name" if key == "record" else "response"
    return f"no {protocol} record has the {what} '{given}'{nearest(str(given), known)}"


def _settings_of(
    preparation: Mapping[str, Sequence[Mapping[str, object] | str] | None],
) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    for protocol, steps in preparation.items():
        for step in steps or ():
            for name, settings in step.items() if isinstance(step, Mapping) else ():
                if isinstance(settings, Mapping):
                    yield protocol, name, settings
