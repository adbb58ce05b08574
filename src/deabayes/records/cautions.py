"""Warnings on one record: what a user must know before trusting it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Quantity
from deabayes.faults import Report
from deabayes.quantities import with_unit
from deabayes.records.channels import (
    STEPS,
    Check,
    dropouts,
    excitation_range,
    glitches,
    is_near,
    knows_prehistory,
    response_jumps,
    share_at,
    standing_out,
    usual_interval,
    value_before,
)
from deabayes.records.columns import COMMANDS
from deabayes.systems.specimen_quantities import instrument

QUANTISED = 0.5
"""Share of equal neighbours above which the steps of a record are coarser than its noise."""
HELD_ALIKE = 0.8
"""Share of readings held for the same number of samples above which a slower clock is assumed."""
FEWEST_HELD = 5
"""Number of successive equal samples at an extreme that noise cannot explain."""
Flags = NDArray[np.bool_]


def warn_of_record(check: Check) -> None:
    """Warn of what a user must know before trusting a record without faults."""
    row, raw, report = check.row, check.raw, check.report
    limit, resolution, noise = (
        check.instrument(name, row.response) for name in ("range", "resolution", "noise")
    )
    unit = raw.units[row.response]
    clipped_sensor(report, check.response, limit, row.response, unit)
    coarse_quantisation(report, check.response, resolution, noise, row.response, unit)
    if raw.left_out:
        report.warn(
            f"{raw.left_out} of {raw.left_out + check.response.size} data rows are left out, "
            "without a value or at a repeated time (record_format.incomplete_rows)"
        )
    if check.in_time:
        sampling_jitter(report, check.time)
        _single_samples(check)
        _jumps(check)
    _beginning(check)
    if row.excitation in COMMANDS:
        report.warn(
            f"{row.excitation} is a command to the amplifier and is used as its output; if the "
            "amplifier could not follow it, begin the preparation with limit_current"
        )
    limit = instrument(check.specimen, "current_limit", "current", "A")
    if limit is not None and "current" in raw.columns:
        current_at_limit(report, raw.columns["current"], limit.value, row.protocol)


def sampling_jitter(report: Report, time: FloatArray) -> None:
    """Warn of uneven sampling and gaps."""
    intervals, usual = np.diff(time), usual_interval(time)
    longest = int(np.argmax(intervals))
    if intervals[longest] > 10.0 * usual:
        report.warn(
            f"a gap of {intervals[longest]:.3g} s after {time[longest]:.6g} s (usual interval "
            f"{usual:.3g} s)"
        )
    share = float(np.mean(np.abs(intervals - usual) > 0.2 * usual))
    if share > 0.01:
        report.warn(
            f"sampling jitter, {share:.0%} of the intervals differ from {usual:.3g} s by more "
            "than 20 %"
        )


def current_at_limit(report: Report, current: FloatArray, limit: float, protocol: str) -> None:
    """Warn of an amplifier that reaches its current limit."""
    share = float(np.mean(np.abs(current) >= 0.98 * limit))
    if share > 0.0:
        sine = protocol == "sine"
        effect = "is distorted" if sine else "rises slower than asked"
        report.warn(
            f"the amplifier is at its current limit of {with_unit(limit, 'A')} in {share:.2%} of "
            f"the record, so the voltage {effect}"
        )


def clipped_sensor(
    report: Report, values: FloatArray, limit: Quantity | None, channel: str, unit: str
) -> None:
    """Warn of a sensor at the end of its range: values at the limit, or a flat top with noise."""
    share = 0.0 if limit is None else share_at(values, limit.value)
    if limit is not None and share > 0.0:
        report.warn(
            f"{share:.2%} of the values lie at the sensor's range of "
            f"{with_unit(limit.value, unit, channel)}, the sensor is clipped",
            f"column {channel}",
        )
    for name, end, run in () if limit is not None else _held_ends(values):
        report.warn(
            f"the {name} value {with_unit(end, unit, channel)} is held for {run} samples in a row "
            f"({np.mean(values == end):.0%} of all), the sensor may be clipped",
            f"column {channel}",
        )


def _held_ends(values: FloatArray) -> Iterator[tuple[str, float, int]]:
    """Yield extremes at which noisy values stay constant, with the longest run of each."""
    for name, end in (("largest", np.max(values)), ("smallest", np.min(values))):
        at_end = values == end
        if _equal_neighbours(values, at_end) > QUANTISED:
            continue  # coarse steps make plateaus by themselves
        run = _longest_run(_without_start_at_rest(values, at_end))
        if run >= FEWEST_HELD:
            yield name, float(end), run


def _equal_neighbours(values: FloatArray, left_out: Flags) -> float:
    """Share of equal neighbouring samples, without pairs that are both `left_out` (M,)."""
    equal = np.diff(values)[~(left_out[1:] & left_out[:-1])] == 0.0
    return float(np.mean(equal)) if equal.size else 0.0


def _without_start_at_rest(values: FloatArray, at_end: Flags) -> Flags:
    """Remove from `at_end` (M,) the run at rest that begins a noise-free record.

    With noise, differences between neighbours change sign in two of three places, and a sensor
    at rest does not stand still.
    """
    moved = np.cumsum(~at_end) > 0
    steps = np.diff(values[moved])
    signs = np.sign(steps[steps != 0.0])
    noisy = signs.size < 2 or np.mean(signs[1:] != signs[:-1]) > 0.4
    return at_end if noisy else at_end & moved


def _longest_run(flags: Flags) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def coarse_quantisation(
    report: Report,
    values: FloatArray,
    resolution: Quantity | None,
    noise: Quantity | None,
    channel: str,
    unit: str,
) -> None:
    """Warn of quantisation coarser than the noise: as stated, or seen in equal neighbours.

    Equal neighbours at an extreme where the sensor may be clipped do not count.
    """
    if resolution is not None and noise is not None and resolution.value > noise.value:
        report.warn(
            f"the resolution {with_unit(resolution.value, unit, channel)} is coarser than the "
            f"noise {with_unit(noise.value, unit, channel)}",
            f"column {channel}",
        )
        return
    if every := _samples_per_reading(values):
        report.warn(
            f"changes every {every} samples only: the sensor was read more seldom than the file "
            "was written, and the repeated values lag; keep the samples at which it changes "
            f"(`decimate: {{every: {every}}}` first in `preparation`)",
            f"column {channel}",
        )
        return
    share = _equal_neighbours(values, np.isin(values, [end for _, end, _ in _held_ends(values)]))
    if share > QUANTISED:
        step = float(np.min(np.diff(np.unique(values)), initial=np.inf))
        shown = with_unit(step if np.isfinite(step) else 0.0, unit, channel, digits=3)
        report.warn(
            f"quantised in steps of {shown}, coarser than the noise ({share:.0%} of neighbouring "
            "samples are equal)",
            f"column {channel}",
        )


def _samples_per_reading(values: FloatArray) -> int:
    """Number of samples for which each reading is held; 0 if readings are not held equally long."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if changes.size < FEWEST_HELD:
        return 0
    lengths = np.diff(changes)
    usual = int(np.median(lengths))
    same = float(np.mean(lengths == usual))
    return usual if usual >= 2 and same > HELD_ALIKE else 0


def _beginning(check: Check) -> None:
    """Warn if a jump is assumed at the first sample because the record does not show it."""
    name, values, system = check.row.excitation, check.excitation, check.specimen.system
    if check.is_step_from_the_start:
        spread = float(np.ptp(values))
        noise = f" but for {check.shown(spread, name, 2)}" if spread else ""
        check.report.warn(
            f"{name} is constant{noise}, so the step is taken to happen at the first sample"
        )
        return
    before = value_before(check.row, system) if check.in_time else None
    if before is None or is_near(float(values[0]), before, values):
        return
    settled = "; if all had settled under it, state `prehistory: equilibrium` in experiments.csv"
    check.report.warn(
        f"{name} begins with {check.shown(values[0], name)} and is assumed to jump there "
        f"from {before:g} at the first sample; if it was on before the record, add the rows since "
        "then"
        f"{settled if knows_prehistory(system, name) else ''}"
    )


def _single_samples(check: Check) -> None:
    """Warn of single outlying samples of a step response, and of any excitation."""
    row, raw = check.row, check.raw
    outliers = {row.excitation: glitches(check.excitation, check.response)}
    if row.protocol in STEPS:
        size = excitation_range(row.protocol, check.excitation, raw.units[row.excitation])
        outliers = {row.response: standing_out(check.excitation, size, check.response), **outliers}
    remedies = {
        row.response: "if the sensor failed there, hide it with `mask_between`",
        row.excitation: "if it was not driven so, correct the row in the file, or remove it",
    }
    for name, samples in outliers.items():
        if samples.size:
            at, values = int(samples[0]), raw.columns[name]
            value, next_value = (check.shown(values[i], name, 6) for i in (at, at + 1))
            check.report.warn(
                f"the single sample at {check.time[at]:.6g} s, {value} before {next_value}, "
                f"stands out{_more(samples)}; {remedies[name]}",
                f"column {name}",
            )


def _more(samples: NDArray[np.intp]) -> str:
    return f" (and {samples.size - 1} more)" if samples.size > 1 else ""


def _jumps(check: Check) -> None:
    """Warn of jumps of the response alone or, in a step or creep, of the excitation alone."""
    row, excitation, response = check.row, check.excitation, check.response
    size = excitation_range(row.protocol, excitation, check.raw.units[row.excitation])
    jumps = {row.response: response_jumps(excitation, size, response)}
    if row.protocol in STEPS:
        jumps[row.excitation] = dropouts(excitation, response)
    remedies = {
        row.response: f"though the {row.excitation} does not; if the specimen or its sensor "
        "slipped or broke there, keep what is before it (`crop`)",
        row.excitation: f"soon jumps back, and the {row.response} does not follow; if it was not "
        "driven so, correct these rows in the file",
    }
    for name, samples in jumps.items():
        if samples.size:
            at, values = int(samples[0]), check.raw.columns[name]
            height = check.shown(values[at] - values[at - 1], name)
            check.report.warn(
                f"jumps by {height} at {check.time[at]:.6g} s{_more(samples)}, {remedies[name]}",
                f"column {name}",
            )
