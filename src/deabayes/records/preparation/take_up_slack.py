"""Preparation step: count the excitation of a pull from where the strip is taut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.quantities import with_unit
from deabayes.records.preparation.working import Settings, WorkingRecord

FORCES = ("force", "nominal_stress")
PULLS = ("stretch", "displacement")
RISE, FEWEST = (0.03, 0.3), 6
"""Shares of the largest force that bound the first rise of a pull, and its fewest samples."""
LEAST = 0.002
"""Smallest slack that is reported, in stretch or as a share of the excitation's range."""
STANDARD_ERRORS = 5.0
AT_REST = 0.25
"""Share of the mean force that a taut strip would have had before the rise. A larger force means
a stiffening rubber, not slack."""


def take_up_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Remove from the excitation the part before the strip became taut.

    A displacement counts from the taut point. A stretch is divided by its value there, because
    the taut strip is longer by that factor. Samples before that point are hidden.

    Settings
    --------
    until : the excitation at which the strip becomes taut; by default the parabola fitted to the
        first rise of the force gives it at zero force.
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
    """Return the excitation at which the force begins to rise; None if it rises at once.

    A parabola of excitation over force, fitted from 3 to 30 % of the largest force, is
    extrapolated to zero force.
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
    """Warning about slack that is not taken up; empty if there is none."""
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
