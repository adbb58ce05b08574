"""Experiments that could be done next: records that were held out, and alterations of records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import PHASE, Experiment, FloatArray
from deabayes.faults import Faults, nearest
from deabayes.study import Settings

HELD = ("creep", "step", "relaxation")
"""Protocols that end with a held excitation, which can be held longer."""
SHOWN = ("deformation", "load_g", "voltage", "bias_kV")
"""Conditions that say what is done, in their column's unit (voltage: V)."""
TIMELESS = ("quasi_static", "frequency_response")


@dataclass(frozen=True)
class Planned:
    """An experiment with all its records (a gain has its phase); `what` describes it in words."""

    name: str
    records: tuple[Experiment, ...]
    what: str
    held_out: bool


def plan(experiments: Sequence[Experiment], asked: Mapping[str, Settings]) -> list[Planned]:
    """The held-out records of a study, and what it asks for under `further_experiments`.

    Raises
    ------
    Faults : entries that name no record, or ask of one what cannot be done.
    """
    protocols = {each.row: each.protocol for each in experiments}
    found = faults(asked, protocols)
    if found:
        raise Faults([f"further_experiments: {fault}" for fault in found])
    rows: dict[str, tuple[Experiment, ...]] = dict.fromkeys(protocols, ())
    for each in experiments:
        rows[each.row] = (*rows[each.row], each)
    held_out = [
        Planned(name, records, described(records[0]), True)
        for name, records in rows.items()
        if records[0].role == "validate"
    ]
    return held_out + [
        _altered_row(name, rows[str(settings["like"])], settings)
        for name, settings in asked.items()
    ]


def faults(asked: Mapping[str, Settings], protocols: Mapping[str, str]) -> list[str]:
    """What is wrong with entries of `further_experiments`, given the records' protocols."""
    found = []
    for name, settings in asked.items():
        like = str(settings["like"])
        protocol = protocols.get(like, "")
        if name in protocols:
            found.append(f"{name} is a record already; give the experiment another name")
        if not protocol:
            found.append(f"{name}: like {like!r} is no record of it{nearest(like, protocols)}")
        elif "speed" in settings and protocol in TIMELESS:
            found.append(f"{name}: {like} has no time ({protocol}), leave out speed")
        elif "duration" in settings and protocol not in HELD:
            found.append(
                f"{name}: {like} ({protocol}) does not end with a held excitation to hold longer, "
                f"as {', '.join(HELD)} do; leave out duration"
                + ("" if protocol in TIMELESS else ", or give speed")
            )
    return found


def altered(experiment: Experiment, name: str, settings: Settings) -> Experiment:
    """An experiment like another one, with settings of `further_experiments` as factors.

    `excitation` multiplies the excitation's distance from rest (which is 0, of a stretch 1),
    `speed` how fast time runs, sampling as before, and `duration` the record's length, its last
    excitation held. No reading is known.
    """
    factors = {key: float(str(value)) for key, value in settings.items() if key != "like"}
    result = replace(experiment, name=name, role="validate", nodes=None, steps=(), warnings=(),
                     metadata={}, record_sha256="")  # fmt: skip
    result = _driven(result, factors.get("excitation", 1.0))
    result = _run(result, factors.get("speed", 1.0))
    result = _held(result, factors.get("duration", 1.0))
    return replace(result, response=np.full(result.coordinate.size, np.nan))


def described(experiment: Experiment) -> str:
    """What is done, in words: protocol, range of the excitation, duration."""
    driven = experiment.excitation
    unit = "" if driven.unit == "1" else f" {driven.unit}"
    low, high = driven.values.min(), driven.values.max()
    low, high = (0.0 if abs(end) < 1e-3 * (high - low) else end for end in (low, high))
    held = "".join(f", {n} {driven.conditions[n]}" for n in SHOWN if driven.conditions.get(n))
    text = f"{experiment.protocol}, {driven.name} {low:.4g} to {high:.4g}{unit}{held}"
    if experiment.coordinate_name != "time":
        return text
    return f"{text}, {np.ptp(experiment.coordinate):.4g} s"


def _altered_row(name: str, records: Sequence[Experiment], settings: Settings) -> Planned:
    endings = [PHASE if each.name.endswith(PHASE) and len(records) > 1 else "" for each in records]
    made = tuple(
        altered(each, name + ending, settings)
        for each, ending in zip(records, endings, strict=True)
    )
    return Planned(name, made, f"{described(made[0])}; {_said(settings)}", False)


def _said(settings: Settings) -> str:
    """An entry of `further_experiments` in words."""
    words = {"excitation": "excitation × {}", "speed": "{} × as fast", "duration": "{} × as long"}
    parts = [words[key].format(value) for key, value in settings.items() if key in words]
    return f"like {settings['like']}" + (f", {', '.join(parts)}" if parts else " once more")


def _driven(experiment: Experiment, factor: float) -> Experiment:
    driven = experiment.excitation
    rest = 1.0 if driven.unit == "1" else 0.0

    def scaled(values: FloatArray) -> FloatArray:
        return rest + factor * (values - rest)

    if experiment.coordinate_name == driven.name:
        excitation = replace(
            driven, coordinate=scaled(driven.coordinate), values=scaled(driven.values)
        )
        return replace(experiment, coordinate=scaled(experiment.coordinate), excitation=excitation)
    return replace(experiment, excitation=replace(driven, values=scaled(driven.values)))


def _run(experiment: Experiment, speed: float) -> Experiment:
    if speed == 1.0:
        return experiment
    driven = experiment.excitation
    return replace(
        experiment,
        coordinate=experiment.coordinate / speed,
        samples_averaged=np.maximum(experiment.samples_averaged / speed, 1.0),
        excitation=replace(driven, coordinate=driven.coordinate / speed),
    )


def _held(experiment: Experiment, factor: float) -> Experiment:
    """At most as many points are added as there are."""
    if factor == 1.0:
        return experiment
    time, driven = experiment.coordinate, experiment.excitation
    last, added = time[-1], (factor - 1.0) * float(np.ptp(time))
    spacing = max(float(time[-1] - time[-2]), added / time.size)
    more = last + spacing * np.arange(1, int(added / spacing + 1e-9) + 1)
    before = driven.coordinate < last
    knots = np.concatenate([driven.coordinate[before], [last, last + added]])
    values = np.concatenate([driven.values[before], np.repeat(driven.at(time[-1:]), 2)])
    averaged = np.append(
        experiment.samples_averaged, np.full(more.size, experiment.samples_averaged[-1])
    )
    return replace(
        experiment,
        coordinate=np.concatenate([time, more]),
        samples_averaged=averaged,
        excitation=replace(driven, coordinate=knots, values=values),
    )
