"""What is done to a record where config.yaml says nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deabayes.instruments import instrument
from deabayes.preparation.flattening import NOTED, flattening, width_for
from deabayes.preparation.ringing import Ringing, ringing
from deabayes.preparation.sine_steps import POINTS, sine_steps
from deabayes.preparation.working import WorkingRecord

Step = Mapping[str, Mapping[str, object]]
HELD = ("creep", "step")
WIDEST = 50.0
"""Widest bins of `average` in a record, as it has them."""
MOST_THINNED = 5
"""Every how many bins may be kept of a ringing record: eight of forty in a period."""

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
"""By protocol; a sine's depend on its record (`sine_steps`), and bins are narrower where a
response to a step rings. Nothing that alters a response is among it, except undoing a delay that
specimen.yaml states as exact; where bins must flatten a response, a warning says by how much."""


def with_default_steps(record: WorkingRecord) -> tuple[WorkingRecord, list[Step]]:
    """The usual steps of a record, an exactly known sensor delay undone first.

    Returns
    -------
    The record, with what is to be said about the steps among its warnings, and the steps.
    """
    protocol = record.row.protocol
    steps = list(DEFAULT_STEPS.get(protocol, ()))
    if protocol == "sine":
        steps = sine_steps(record)
    elif protocol in HELD and (rings := ringing(record)) is not None:
        record, steps = _ringing_steps(record, rings)
    sensor = instrument(record.specimen, "delay", record.row.response, "s")
    delayed = record.coordinate_name in ("time", "frequency")
    known = sensor is not None and sensor.sd is None and delayed
    return record, [{"delay": {}}, *steps] if known else steps


def _ringing_steps(record: WorkingRecord, rings: Ringing) -> tuple[WorkingRecord, list[Step]]:
    """Bins of a fortieth of the ringing's period, if the record is not too long for that."""
    usual = list(DEFAULT_STEPS[record.row.protocol])
    span = float(np.ptp(record.coordinate))
    narrow = width_for(0.2 * NOTED, 1.0 / rings.period)
    if narrow >= span / WIDEST:
        return record, usual
    every = int(np.ceil(span / narrow / POINTS))
    average: Step = {"average": {"grid": "geometric", "widest": f"{narrow:.4g} s"}}
    if every <= MOST_THINNED:
        thinned: list[Step] = [{"decimate": {"every": every}}] if every > 1 else []
        return record, [usual[0], average, *thinned]
    widest = min(span / WIDEST, 0.1 * (rings.end - rings.start))
    if flattening(widest, 1.0 / rings.period) <= NOTED:
        return record, usual
    return record.with_warning(_flattened(record, rings, widest, narrow)), usual


def _flattened(record: WorkingRecord, rings: Ringing, widest: float, narrow: float) -> str:
    lost = flattening(widest, 1.0 / rings.period)
    return (
        f"the {record.row.response} rings with a period of {rings.period:.3g} s until "
        f"{rings.end:.4g} s, and bins of up to {widest:.2g} s flatten that by up to {lost:.0%}: "
        "candidates without mass do not ring either; for those with mass give "
        f"`preparation: {record.row.protocol}:` with a `crop` to the ringing and `average: "
        f"{{widest: {narrow:.2g} s}}`"
    )
