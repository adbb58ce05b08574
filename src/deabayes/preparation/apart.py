"""Whether a response begins with its excitation: a sensor may lag, or two clocks differ."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.instruments import instrument
from deabayes.preparation.rest import noise_of
from deabayes.preparation.working import WorkingRecord
from deabayes.quantities import with_unit
from deabayes.reading.held import STEPS

BEGUN, COMPLETE = 0.1, 0.9
"""Shares of an excitation's range at which it has begun, and at which it is complete."""
MOVED, JUMPED = 0.02, 0.2
"""Shares of a response's range: of one that has begun, and of one that jumps. No mass, and no
circuit, is first at rest and then so fast."""
AT_ONCE = 0.5
"""Of a response's range: its first step after a single sample at rest, which may be chance."""
FEWEST = 2
STANDARD_DEVIATIONS = 6.0


def begins_apart(record: WorkingRecord) -> str:
    """What there is to say of a response that begins after, or before, a step of its excitation."""
    row = record.row
    if row.protocol not in STEPS or not record.in_time:
        return ""
    if instrument(record.specimen, "delay", row.response, "s") is not None:
        return ""
    time, response = record.coordinate, record.response
    driven = np.abs(record.excitation - record.excitation[0])
    size, noise = float(np.ptp(response)), noise_of(response)
    first = int(np.argmax(driven > BEGUN * driven.max()))
    before = response[: max(first - FEWEST, 1)]
    moved = np.abs(response - np.median(before))
    begun = int(np.argmax(moved > max(MOVED * size, STANDARD_DEVIATIONS * noise)))
    apart = with_unit(float(abs(time[begun] - time[first])), "s", digits=3)
    if first == 0:
        return ""
    if first - begun >= FEWEST and moved[begun:first].min() > JUMPED * size:
        return (
            f"the {row.response} begins {apart} before the {row.excitation}, which it cannot: "
            "their clocks differ, or it is another channel; correct the time of one of them"
        )
    if not _jumps(moved / size, driven / driven.max(), first, begun):
        return ""
    return (
        f"the {row.response} begins {apart} after the {row.excitation}, and then jumps: if its "
        "sensor lags, state `instruments: delay: {value: ..., unit: ms}` in specimen.yaml (up to "
        f"{apart}); the usual steps take a stated delay out"
    )


def _jumps(moved: FloatArray, driven: FloatArray, first: int, begun: int) -> bool:
    """Whether a response rests for samples, or one after the whole step, and then jumps."""
    if begun + 1 >= moved.size or begun <= first:
        return False
    if begun - first >= FEWEST:
        return bool(moved[begun + 1] > JUMPED)
    return bool(driven[first] > COMPLETE and moved[begun] > AT_ONCE)
