"""Checks of what instruments do to a record: at their limits, clipped, quantised.

They return sentences as those in `checks` do.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit

Flags = NDArray[np.bool_]
MOSTLY = 0.5
"""Share of a record at its sensor's limit from which it says nothing of the rest."""
QUANTISED = 0.5
"""Share of neighbours that are equal, from which a record is quantised more coarsely than noisy."""
HELD_ALIKE = 0.8
"""Share of a channel's readings that are held equally long where a slower clock reads it."""
FEWEST_HELD = 5
"""Samples in a row at an extreme that no noise leaves alike."""


def current_at_limit(current: FloatArray, limit: float, protocol: str, where: str) -> list[str]:
    """An amplifier that runs into its current limit."""
    share = float(np.mean(np.abs(current) >= 0.98 * limit))
    if share == 0.0:
        return []
    effect = (
        "the voltage is distorted" if protocol == "sine" else "the voltage rises slower than asked"
    )
    return [f"{where}: the amplifier is at its current limit of {with_unit(limit, 'A')} in "
            f"{share:.2%} of the record, so {effect}"]  # fmt: skip


def clipped_sensor(
    values: FloatArray, limit: float | None, channel: str, unit: str, where: str
) -> list[str]:
    """A sensor at the end of its range: values at the limit, or a flat top in a noisy record."""
    if limit is not None:
        share = float(np.mean(np.abs(values) >= 0.999 * limit))
        if share > 0.0:
            reach = with_unit(limit, unit, channel)
            return [f"{where}, column {channel}: {share:.2%} of the values lie at the sensor's "
                    f"range of {reach}, the sensor is clipped"]  # fmt: skip
    return [
        f"{where}, column {channel}: the {name} value {with_unit(end, unit, channel)} is held for "
        f"{run} samples in a row ({np.mean(values == end):.0%} of all), the sensor may be clipped"
        for name, end, run in _held_ends(values)
    ]


def mostly_clipped(
    values: FloatArray, limit: float | None, channel: str, unit: str, where: str
) -> list[str]:
    """Fault: a channel that is at its instrument's limit for most of the record."""
    share = 0.0 if limit is None else float(np.mean(np.abs(values) >= 0.999 * limit))
    if limit is None or share <= MOSTLY:
        return []
    return [
        f"{where}, column {channel}: {share:.0%} of the values lie at the sensor's range of "
        f"{with_unit(limit, unit, channel)}; record it with a wider range, or cut the record there"
    ]


def _held_ends(values: FloatArray) -> Iterator[tuple[str, float, int]]:
    """Extremes at which the values stay, and how many in a row; none where they stay elsewhere."""
    for name, end in (("largest", np.max(values)), ("smallest", np.min(values))):
        held = values == end
        if _equal_neighbours(values, held) > QUANTISED:
            continue  # quantised so coarsely that plateaus say nothing
        run = longest_run(_without_start_at_rest(values, held))
        if run >= FEWEST_HELD:
            yield name, float(end), run


def _equal_neighbours(values: FloatArray, left_out: Flags) -> float:
    """Share of neighbouring samples that are equal, but for those both `left_out` (M,)."""
    equal = np.diff(values)[~(left_out[1:] & left_out[:-1])] == 0.0
    return float(np.mean(equal)) if equal.size else 0.0


def _without_start_at_rest(values: FloatArray, held: Flags) -> Flags:
    """`held` (M,) without the run that begins a noise-free record: at rest, nothing moves yet.

    Where there is noise, differences of neighbours change their sign in two of three
    places, and a sensor at rest does not stand still.
    """
    moved = np.cumsum(~held) > 0
    steps = np.diff(values[moved])
    signs = np.sign(steps[steps != 0.0])
    noisy = signs.size < 2 or np.mean(signs[1:] != signs[:-1]) > 0.4
    return held if noisy else held & moved


def coarse_quantisation(
    values: FloatArray,
    resolution: float | None,
    noise: float | None,
    channel: str,
    unit: str,
    where: str,
) -> list[str]:
    """Quantisation coarser than the noise: stated, or seen as equal neighbours.

    Those at an end where the sensor may be clipped say nothing of its steps.
    """
    if resolution is not None and noise is not None and resolution > noise:
        return [f"{where}, column {channel}: the resolution "
                f"{with_unit(resolution, unit, channel)} is coarser than the noise "
                f"{with_unit(noise, unit, channel)}"]  # fmt: skip
    if held := samples_held(values):
        return [f"{where}, column {channel}: changes every {held} samples only: it was read more "
                "seldom than it was written, and what is held lags; keep the samples at which it "
                f"changes (`decimate: {{every: {held}}}` first in `preparation`)"]  # fmt: skip
    share = _equal_neighbours(values, np.isin(values, [end for _, end, _ in _held_ends(values)]))
    if share <= QUANTISED:
        return []
    steps = np.diff(np.unique(values))
    step = float(np.min(steps)) if steps.size else 0.0
    seen = with_unit(step, unit, channel, digits=3)
    return [f"{where}, column {channel}: quantised in steps of {seen}, coarser than the noise "
            f"({share:.0%} of neighbouring samples are equal)"]  # fmt: skip


def samples_held(values: FloatArray) -> int:
    """For how many samples each reading is held; 0 where readings are not held alike."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if changes.size < FEWEST_HELD:
        return 0
    lengths = np.diff(changes)
    usual = int(np.median(lengths))
    alike = float(np.mean(lengths == usual))
    return usual if usual >= 2 and alike > HELD_ALIKE else 0


def longest_run(flags: Flags) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
