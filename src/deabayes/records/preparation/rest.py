"""A record before and at its first step: offset and drift at rest, and delay of the response."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit
from deabayes.records.excitation import STEPS
from deabayes.records.glitches import least_swing, white_noise, without_single_samples
from deabayes.records.preparation.working import WorkingRecord
from deabayes.systems import system_class
from deabayes.systems.specimen_quantities import instrument

AT_REST = 0.01
"""Largest first value of the excitation, as a share of its largest value, that counts as rest."""
EARLY = 0.05
"""Share of the excitation's largest value up to which samples are used to extrapolate to rest."""
CONFIRMED = 0.5
"""The first sample must reach this share of an extrapolated reading at rest."""
FEWEST = 3
MEDIAN = 1.2533
"""Standard error of a median divided by the standard error of a mean."""
LEAST, ERRORS = 1e-4, 5.0
"""Limits above which a reading at rest is an offset: share of the response's range, and number
of standard errors."""
DRIFT, OVER_SCATTER, FEWEST_OF_DRIFT = 0.005, 6.0, 8
"""Limits above which a drift at rest matters: share of the response's range, and multiple of the
scatter about the fitted line (a period of hum stays below it). Last, the fewest samples."""


@dataclass(frozen=True)
class Rest:
    """The reading at rest and its standard error.

    `seen` tells whether the record shows the rest; otherwise the reading is extrapolated.
    """

    record: WorkingRecord
    value: float
    error: float
    seen: bool

    @cached_property
    def is_offset(self) -> bool:
        """Whether the reading differs significantly from zero."""
        least = LEAST * float(np.ptp(self.record.response))
        return abs(self.value) > max(ERRORS * self.error, least)

    def sentence(self, corrected: bool) -> str:
        """Sentence on an offset: that it was subtracted, or how to remove it."""
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
    """Reading before the excitation starts, or extrapolated to zero excitation; else None.

    Also None if the response is not zero at rest, or if the record does not begin at rest.
    """
    known = record.row.response in system_class(record.specimen.system).zero_at_rest
    if not (known and _begins_at_rest(record)):
        return None
    gone = _departure(record)
    before = record.used & (record.coordinate < record.excitation_start())
    noise = white_noise(record.response[record.used])
    if before.sum() >= FEWEST:
        value = float(np.median(record.response[before]))  # the median ignores single outliers
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
        return None  # the reading is about zero at first, then rises fast
    return Rest(record, value, noise * float(np.sqrt(inverse[0, 0])), False)


def drift_at_rest(record: WorkingRecord) -> str:
    """Warning about a response that drifts before the excitation starts; empty if it does not."""
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
    """Distance of the excitation from its value at rest."""
    return np.abs(record.excitation - (1.0 if record.row.excitation == "stretch" else 0.0))


def _begins_at_rest(record: WorkingRecord) -> bool:
    gone = _departure(record)
    return bool(record.in_time and gone[0] <= AT_REST * gone.max())


BEGUN, COMPLETE = 0.1, 0.9
"""Shares of an excitation's range at which it has begun, and at which it is complete."""
MOVED, JUMPED = 0.02, 0.2
"""Shares of a response's range: above the first it has begun, above the second it jumps. With a
mass or a circuit, a response cannot rest at first and then be so fast."""
AT_ONCE = 0.5
"""Share of a response's range for its first step after a single sample at rest; a smaller step
may be chance."""
FEWEST_APART = 2
STANDARD_DEVIATIONS = 6.0


def begins_apart(record: WorkingRecord) -> str:
    """Warning about a response that begins before or after a step of its excitation; else empty."""
    row = record.row
    if row.protocol not in STEPS or not record.in_time:
        return ""
    if instrument(record.specimen, "delay", row.response, "s") is not None:
        return ""
    time, response = record.coordinate, record.response
    driven = np.abs(record.excitation - record.excitation[0])
    size, noise = float(np.ptp(response)), white_noise(response)
    first = int(np.argmax(driven > BEGUN * driven.max()))
    before = response[: max(first - FEWEST_APART, 1)]
    moved = np.abs(response - np.median(before))
    begun = int(np.argmax(moved > max(MOVED * size, STANDARD_DEVIATIONS * noise)))
    apart = with_unit(float(abs(time[begun] - time[first])), "s", digits=3)
    if first == 0:
        return ""
    if first - begun >= FEWEST_APART and moved[begun:first].min() > JUMPED * size:
        return (
            f"the {row.response} begins {apart} before the {row.excitation}, which is impossible: "
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
    """Whether a response rests for some samples, or for one after the full step, and then jumps."""
    if begun + 1 >= moved.size or begun <= first:
        return False
    if begun - first >= FEWEST_APART:
        return bool(moved[begun + 1] > JUMPED)
    return bool(driven[first] > COMPLETE and moved[begun] > AT_ONCE)
