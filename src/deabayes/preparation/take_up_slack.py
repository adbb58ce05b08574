"""Count the excitation of a pull from where the strip is taut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord
from deabayes.quantities import with_unit

FORCES = ("force", "nominal_stress")
PULLS = ("stretch", "displacement")
LINE = (0.05, 0.2)
"""Shares of the largest force between which a pull is taken for a straight line."""
LEAST = 0.002
"""Of stretch, or of the excitation's range: slack below which nothing is said."""
STANDARD_ERRORS = 5.0


def take_up_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Subtract from the excitation what it had gone through before the strip pulled.

    A displacement counts from there; a stretch is divided by the one there, because the
    taut strip is as much longer. What was recorded before is hidden.

    Settings
    --------
    until : the excitation at which the strip is taut; default where the line through the first
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

    The line through the first rise of the force, between 5 and 20 % of the largest, meets zero
    there. A taut elastomer is stiffest at first, so that its line meets zero below.
    """
    row = record.row
    if row.response not in FORCES or row.excitation not in PULLS:
        return None
    peak = int(np.argmax(record.response))
    driven = np.interp(record.coordinate, record.excitation_coordinate, record.excitation)
    force = record.response[: peak + 1] / (record.response[peak] or 1.0)
    past = np.flatnonzero(force > LINE[1])
    rise = np.flatnonzero(force[: past[0] if past.size else 0] > LINE[0])
    if rise.size < 3:
        return None
    x = driven[rise[0] : past[0]]
    basis = np.column_stack([np.ones_like(x), x])
    (offset, slope), *_ = np.linalg.lstsq(basis, force[rise[0] : past[0]], rcond=None)
    error = _error(basis, force[rise[0] : past[0]], np.array([offset, slope]))
    end, start = -offset / slope, float(driven[0])
    least = LEAST * (1.0 if row.excitation == "stretch" else float(np.ptp(driven)))
    return float(end) if end - start > max(least, STANDARD_ERRORS * error) else None


def _error(basis: FloatArray, force: FloatArray, line: FloatArray) -> float:
    """Standard error of where a line meets zero."""
    residual = force - basis @ line
    variance = float(residual @ residual) / max(force.size - 2, 1)
    end = -line[0] / line[1]
    gradient = np.array([1.0, end]) / line[1]
    covariance = np.linalg.inv(basis.T @ basis)
    return float(np.sqrt(variance * gradient @ covariance @ gradient))


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
