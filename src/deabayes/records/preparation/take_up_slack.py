"""Count the excitation of a pull from where the strip is taut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.quantities import with_unit
from deabayes.records.preparation.working import Settings, WorkingRecord

FORCES = ("force", "nominal_stress")
PULLS = ("stretch", "displacement")
RISE, FEWEST = (0.03, 0.3), 6
"""Shares of the largest force of the first rise of a pull, and the fewest samples in it."""
LEAST = 0.002
"""Of stretch, or of the excitation's range: slack below which nothing is said."""
STANDARD_ERRORS = 5.0
AT_REST = 0.25
"""Of the force that a taut strip would have had on average until the rise: more is no slack, but a
rubber that stiffens."""


def take_up_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Subtract from the excitation what it had gone through before the strip pulled.

    A displacement counts from there; a stretch is divided by the one there, because the
    taut strip is as much longer. What was recorded before is hidden.

    Settings
    --------
    until : the excitation at which the strip is taut; default where the parabola through the first
        rise of the force meets zero.
    """
    read = Settings("take_up_slack", settings, record, ("until",))
    found = slack_end(record)
    usual = float(record.excitation[0]) if found is None else found
    taut = read.quantity("until", record.excitation_unit, usual)
    driven = np.interp(record.coordinate, record.excitation_coordinate, record.excitation)
    hidden = np.logical_and.accumulate(driven < taut)
    values = np.maximum(record.excitation, taut)
    stretched = record.row.excitation == "stretch"
    return replace(record.mask(hidden), excitation=values / taut if stretched else values - taut)


def slack_end(record: WorkingRecord) -> float | None:
    """The excitation at which the force begins to rise; None where it does so at once.

    A parabola of the excitation over the force, from 3 to 30 % of the largest, has it at no force.
    """
    row = record.row
    if row.response not in FORCES or row.excitation not in PULLS:
        return None
    peak = int(np.argmax(record.response))
    driven = np.interp(record.coordinate, record.excitation_coordinate, record.excitation)
    force = record.response[: peak + 1] / (record.response[peak] or 1.0)
    past = np.flatnonzero(force > RISE[1])
    rise = np.flatnonzero(force[: past[0] if past.size else 0] > RISE[0])
    if rise.size < FEWEST:
        return None
    f, x = force[rise[0] : past[0]], driven[rise[0] : past[0]]
    basis = np.vander(f, 3, increasing=True)
    inverse = np.linalg.pinv(basis.T @ basis)
    parabola = inverse @ basis.T @ x
    variance = float(np.sum((x - basis @ parabola) ** 2)) / (f.size - 3)
    error = float(np.sqrt(variance * inverse[0, 0]))
    least = LEAST * (1.0 if row.excitation == "stretch" else float(np.ptp(driven)))
    taut = float(parabola[0])
    slack = taut - float(driven[0])
    if slack <= max(least, STANDARD_ERRORS * error):
        return None
    if_taut = 0.5 * slack / float(parabola[1])
    before = force[driven[: peak + 1] < taut]
    return taut if abs(float(np.mean(before))) < AT_REST * if_taut else None


def slack_left_in(record: WorkingRecord) -> str:
    """What there is to say of slack where no step takes it up; empty if there is none."""
    end = slack_end(record)
    if end is None:
        return ""
    name, protocol = record.row.excitation, record.row.protocol
    at = with_unit(end, record.excitation_unit, name, digits=4)
    return (
        f"the {record.row.response} begins to rise at a {name} of {at}: the strip hangs slack "
        f"until then, and a modulus comes out too small; put `take_up_slack: {{}}` first in "
        f"`preparation: {protocol}`"
    )
