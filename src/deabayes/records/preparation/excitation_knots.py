"""Preparation step: describe the excitation by few straight pieces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.faults import UserError
from deabayes.records.preparation.polyline import polyline
from deabayes.records.preparation.working import Settings, WorkingRecord

DEFAULT_FRACTION, LARGEST_FRACTION = 1e-3, 0.5
MANY_KNOTS = 5000
OVER_NOISE = 3.0


def excitation_knots(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Reduce the excitation to a polyline that stays within a tolerance of every sample.

    The whole history is described, including masked times. Knots are measured samples; nothing
    is smoothed.

    Settings
    --------
    tolerance : in the excitation's unit, e.g. 0.05 mm, at most half of its range; or
    fraction : tolerance as a share of the excitation's range, default 0.001. For a voltage that
        is constant apart from noise, the range counts from zero.
    """
    read = Settings("excitation_knots", settings, record, ("tolerance", "fraction"))
    read.at_most_one("tolerance", "fraction")
    if read.has("tolerance"):
        tolerance = read.positive("tolerance", record.excitation_unit)
        most, unit = LARGEST_FRACTION * record.excitation_range, record.excitation_unit
        if tolerance > most:
            raise UserError(
                f"{read.where}.tolerance: {tolerance:.3g} {unit} is more than {most:.3g} {unit}, "
                f"half of the {record.row.excitation}'s range, so that a step becomes a ramp; "
                "give a smaller one, or `fraction`"
            )
    else:
        fraction = read.number("fraction", DEFAULT_FRACTION, 0.0, LARGEST_FRACTION)
        tolerance = fraction * record.excitation_range
    knots = polyline(record.excitation_coordinate, record.excitation, tolerance)
    reduced = replace(
        record,
        excitation_coordinate=record.excitation_coordinate[knots],
        excitation=record.excitation[knots],
    )
    if knots.size <= MANY_KNOTS:
        return reduced
    return reduced.with_warning(
        f"the excitation needs {knots.size} knots for its {record.excitation.size} samples within "
        f"{tolerance:.3g} {record.excitation_unit}: {_why(record, tolerance)}"
    )


def _why(record: WorkingRecord, tolerance: float) -> str:
    """Say why there are many knots: noise, seen in fourth differences, or frequent turns."""
    rough = np.abs(np.diff(record.excitation, 4))
    noise = 1.4826 * float(np.median(rough)) / np.sqrt(70.0) if rough.size else 0.0
    if OVER_NOISE * noise > tolerance:
        return "its noise exceeds the tolerance; widen it"
    return "it turns that often; a wider tolerance needs fewer, `crop` shortens the record"
