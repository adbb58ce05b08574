"""What is done to a record where config.yaml says nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deabayes.instruments import instrument
from deabayes.preparation.flattening import NOTED, width_for
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
specimen.yaml states as exact, and subtracting an offset that is seen at rest."""


def default_steps(record: WorkingRecord, offset: bool = False) -> list[Step]:
    """The usual steps of a record.

    An exactly known sensor delay is undone first, an `offset` at rest second.
    """
    protocol = record.row.protocol
    steps = list(DEFAULT_STEPS.get(protocol, ()))
    if protocol == "sine":
        steps = sine_steps(record)
    elif protocol in HELD and (rings := ringing(record)) is not None:
        steps = _ringing_steps(record, rings)
    if offset:
        steps = [{"baseline": {}}, *steps]
    sensor = instrument(record.specimen, "delay", record.row.response, "s")
    delayed = record.coordinate_name in ("time", "frequency")
    known = sensor is not None and sensor.sd is None and delayed
    return [{"delay": {}}, *steps] if known else steps


def _ringing_steps(record: WorkingRecord, rings: Ringing) -> list[Step]:
    """Bins of a fortieth of the ringing's period, if the record is not too long for that."""
    usual = list(DEFAULT_STEPS[record.row.protocol])
    span = float(np.ptp(record.coordinate))
    narrow = width_for(0.2 * NOTED, 1.0 / rings.period)
    every = int(np.ceil(span / narrow / POINTS))
    if narrow >= span / WIDEST or every > MOST_THINNED:
        return usual
    average: Step = {"average": {"grid": "geometric", "widest": f"{narrow:.4g} s"}}
    return [usual[0], average, *([{"decimate": {"every": every}}] if every > 1 else [])]
