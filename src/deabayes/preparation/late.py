"""Whether a response begins late: a delay of the sensor that nobody has stated."""

from __future__ import annotations

import numpy as np

from deabayes.instruments import instrument
from deabayes.preparation.rest import noise_of
from deabayes.preparation.working import WorkingRecord
from deabayes.quantities import with_unit
from deabayes.reading.held import STEPS

DRIVEN, MOVED, JUMPED = 0.1, 0.02, 0.2
"""Shares of a range: of an excitation that has begun, of a response that has, and of one that
jumps: no mass, and no circuit, is first at rest and then so fast."""
FEWEST = 2
STANDARD_DEVIATIONS = 6.0


def begins_late(record: WorkingRecord) -> str:
    """What there is to say of a response to a step that rests for samples and then jumps."""
    row = record.row
    if row.protocol not in STEPS or not record.in_time:
        return ""
    if instrument(record.specimen, "delay", row.response, "s") is not None:
        return ""
    time, response = record.coordinate, record.response
    driven = np.abs(record.excitation - record.excitation[0])
    size, noise = float(np.ptp(response)), noise_of(response)
    first = int(np.argmax(driven > DRIVEN * driven.max()))
    moved = np.abs(response - np.median(response[: max(first, 1)]))
    begun = int(np.argmax(moved > max(MOVED * size, STANDARD_DEVIATIONS * noise)))
    jumps = begun + 1 < moved.size and moved[begun + 1] > JUMPED * size
    if first == 0 or begun - first < FEWEST or not jumps:
        return ""
    late = with_unit(float(time[begun] - time[first]), "s", digits=3)
    return (
        f"the {row.response} begins {late} after the {row.excitation}, and then jumps: if its "
        "sensor lags, state `instruments: delay: {value: ..., unit: ms}` in specimen.yaml (up to "
        f"{late}); the usual steps take a stated delay out"
    )
