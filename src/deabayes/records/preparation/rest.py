"""A record before and at its first step: offset, drift, and whether the response begins with it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit
from deabayes.records.excitation import STEPS
from deabayes.records.glitches import least_swing, without_single_samples
from deabayes.records.preparation.working import WorkingRecord
from deabayes.systems import system_class
from deabayes.systems.specimen_quantities import instrument

AT_REST = 0.01
"""Of its range: how far the excitation's first value may be from none."""
EARLY = 0.05
"""Of its range: how far the excitation has gone where a reading at rest is extrapolated from."""
CONFIRMED = 0.5
"""Of an extrapolated reading at rest: what the first sample must have of it."""
FEWEST = 3
MEDIAN = 1.2533
"""Standard error of a median over that of a mean."""
LEAST, ERRORS = 1e-4, 5.0
"""Of the response's range, and standard errors, above which a reading at rest is an offset."""
DRIFT, OVER_SCATTER, FEWEST_OF_DRIFT = 0.005, 6.0, 8
"""Of the response's range, and of the scatter about its line: a drift at rest that matters, which a
period of hum is not; and the fewest samples by which it is known."""


@dataclass(frozen=True)
class Rest:
    """The reading at rest, its standard error, and whether there was a rest: else extrapolated."""

    record: WorkingRecord
    value: float
    error: float
    seen: bool

    @cached_property
    def is_offset(self) -> bool:
        """Whether it is not zero."""
        least = LEAST * float(np.ptp(self.record.response))
        return abs(self.value) > max(ERRORS * self.error, least)

    def sentence(self, corrected: bool) -> str:
        """What there is to say of an offset: what was done, or what to write."""
        record = self.record
        name, protocol = record.row.response, record.row.protocol
        size = with_unit(self.value, record.response_unit, name, digits=3)
        errors = f"{abs(self.value) / self.error:.0f} standard errors" if self.error else "no noise"
        said = f"the {name} is {size} at rest, where the model has 0 ({errors})"
        if corrected:
            return f"{said}; it was subtracted (`baseline`)"
        if self.seen:
            return f"{said}; add `baseline: {{}}` to `preparation: {protocol}`"
        return (
            f"{said}; rows from before the excitation let `baseline` subtract it, and "
            "`noise: ornstein_uhlenbeck_offset` in the study estimates it"
        )


def reading_at_rest(record: WorkingRecord) -> Rest | None:
    """The reading before the excitation, or extrapolated to none of it; None if neither is there.

    Also None for a response that is not zero at rest, and a record that does not begin at rest.
    """
    known = record.row.response in system_class(record.specimen.system).zero_at_rest
    if not (known and _begins_at_rest(record)):
        return None
    gone = _departure(record)
    before = record.used & (record.coordinate < record.excitation_start())
    noise = noise_of(record.response[record.used])
    if before.sum() >= FEWEST:
        value = float(np.median(record.response[before]))  # a single sample is no offset
        return Rest(record, value, MEDIAN * noise / float(np.sqrt(before.sum())), True)
    early = np.interp(record.coordinate, record.excitation_coordinate, gone) <= EARLY * gone.max()
    first = record.used & np.logical_and.accumulate(early)
    if first.sum() < FEWEST + 1:
        return None
    basis = np.column_stack([np.ones(first.sum()), record.coordinate[first]])
    basis[:, 1] -= basis[0, 1]
    inverse = np.linalg.inv(basis.T @ basis)
    value = float((inverse @ basis.T @ record.response[first])[0])
    if abs(record.response[first][0]) < CONFIRMED * abs(value):
        return None  # it reads none at first, and then rises fast
    return Rest(record, value, noise * float(np.sqrt(inverse[0, 0])), False)


def drift_at_rest(record: WorkingRecord) -> str:
    """What there is to say of a response that still moves before the excitation does."""
    name = record.row.response
    if record.row.protocol not in STEPS or not _begins_at_rest(record):
        return ""
    before = record.used & (record.coordinate < record.excitation_start())
    if before.sum() < FEWEST_OF_DRIFT:
        return ""
    time, response = record.coordinate[before], record.response[before]
    response = without_single_samples(response, least_swing(response))
    length, size = float(np.ptp(time)), float(np.ptp(record.response[record.used]))
    line = np.polyfit(time - time[0], response, 1)
    scatter = float(np.std(response - np.polyval(line, time - time[0])))
    moved = float(line[0]) * length
    if abs(moved) <= max(OVER_SCATTER * scatter, DRIFT * size):
        return ""
    return (
        f"the {name} drifts by {with_unit(moved, record.response_unit, name, digits=2)} "
        f"({100 * abs(moved) / size:.2g} % of its range) in the {with_unit(length, 's', digits=2)} "
        f"before the {record.row.excitation} changes, and the model begins at rest: slow units "
        "take such a drift for creep; let the specimen settle longer before the record"
    )


def _departure(record: WorkingRecord) -> FloatArray:
    """How far the excitation is from none."""
    return np.abs(record.excitation - (1.0 if record.row.excitation == "stretch" else 0.0))


def _begins_at_rest(record: WorkingRecord) -> bool:
    gone = _departure(record)
    return bool(record.in_time and gone[0] <= AT_REST * gone.max())


def noise_of(response: FloatArray) -> float:
    """Standard deviation of white noise, from second differences: a trend has none."""
    bent = np.abs(np.diff(response, 2))
    return float(np.median(bent)) / (0.6745 * np.sqrt(6.0)) if bent.size else 0.0


BEGUN, COMPLETE = 0.1, 0.9
"""Shares of an excitation's range at which it has begun, and at which it is complete."""
MOVED, JUMPED = 0.02, 0.2
"""Shares of a response's range: of one that has begun, and of one that jumps. No mass, and no
circuit, is first at rest and then so fast."""
AT_ONCE = 0.5
"""Of a response's range: its first step after a single sample at rest, which may be chance."""
FEWEST_APART = 2
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
    before = response[: max(first - FEWEST_APART, 1)]
    moved = np.abs(response - np.median(before))
    begun = int(np.argmax(moved > max(MOVED * size, STANDARD_DEVIATIONS * noise)))
    apart = with_unit(float(abs(time[begun] - time[first])), "s", digits=3)
    if first == 0:
        return ""
    if first - begun >= FEWEST_APART and moved[begun:first].min() > JUMPED * size:
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
    if begun - first >= FEWEST_APART:
        return bool(moved[begun + 1] > JUMPED)
    return bool(driven[first] > COMPLETE and moved[begun] > AT_ONCE)
