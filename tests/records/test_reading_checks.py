"""Checks of single channels: each reports what it should and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from deabayes.experiment import Quantity
from deabayes.faults import Report
from deabayes.records import cautions, checks

RNG = np.random.default_rng(7)
TIME = np.arange(200) * 0.02
NOISY = np.sin(TIME) + 1e-3 * RNG.normal(size=TIME.size)
CLIPPED = np.minimum(NOISY, 0.8)
RISE = 1.0 - np.exp(-np.maximum(TIME - 0.5, 0.0))
COARSE = np.round(NOISY / 0.2) * 0.2
JITTERED = TIME + 0.02 * np.where(np.arange(200) % 20 == 3, 0.6, 0.0)
GAP = TIME + np.where(np.arange(200) > 100, 3.0, 0.0)
STEP = np.where(TIME < 0.5, 0.0, 1.0) * (1.0 + 0.1 * TIME)
MOSTLY_CLIPPED = np.minimum(STEP + 1e-3 * RNG.normal(size=TIME.size), 1.0)
COARSE_STEP = np.round(STEP / 0.2) * 0.2
CURRENT = np.where(TIME < 0.5, 0.12, 0.0)


def newton(value: float) -> Quantity:
    return Quantity(value, "N")


def force(check: Callable[..., None], values: np.ndarray, *stated: Quantity | None) -> tuple:
    """A check of a force: the check, its values, what the instrument states, channel, unit."""
    return (check, values, *stated, "force", "N")


REPORTED: list[tuple[tuple, list[str]]] = [
    (force(cautions.clipped_sensor, NOISY, newton(0.9)), ["column force", "range of 900 mN"]),
    (force(cautions.clipped_sensor, CLIPPED, None), ["largest value 800 mN", "held"]),
    (force(cautions.clipped_sensor, -CLIPPED, None), ["smallest value -800 mN"]),
    (
        force(cautions.clipped_sensor, MOSTLY_CLIPPED, None),
        ["largest value 1 N is held for 175 samples in a row (88% of all)", "clipped"],
    ),
    (force(cautions.clipped_sensor, np.minimum(RISE, 0.9), None), ["value 900 mN"]),
    (force(cautions.clipped_sensor, np.maximum(NOISY, 0.1), None), ["value 100 mN"]),
    (force(cautions.coarse_quantisation, COARSE_STEP, None, None), ["steps of 200 mN"]),
    (force(cautions.coarse_quantisation, COARSE, None, None), ["steps of 200 mN"]),
    (
        force(cautions.coarse_quantisation, NOISY, newton(1e-2), newton(1e-3)),
        ["resolution 10 mN", "noise 1 mN"],
    ),
    ((cautions.sampling_jitter, JITTERED), ["jitter", "10%", "0.02 s"]),
    ((cautions.sampling_jitter, GAP), ["gap of 3.02 s after 2 s"]),
    ((cautions.current_at_limit, CURRENT, 0.12, "creep"), ["120 mA", "12.50%"]),
    ((cautions.current_at_limit, CURRENT, 0.12, "sine"), ["distorted"]),
    ((checks.not_positive, np.array([1.0, 0.0]), "stretch"), ["data row 2", "offset"]),
    ((checks.not_positive, np.array([1.0, -40.0]), "gain"), ["is -40", "no decibels"]),
    ((checks.not_positive, np.array([0.0, 1.0]), "frequency"), ["remove the row"]),
    (
        (checks.not_finite, np.array([1.0, np.nan, np.inf, 1.0, np.nan]), "force"),
        ["infinite: 3", "data row 2", "a run of 2"],
    ),
    ((checks.not_finite, np.array([1.0, np.nan, np.nan]), "force"), ["infinite: 2", "a run of 2"]),
    (
        (checks.not_finite, np.full(3, np.nan), "phase"),
        ["column phase", "no value in any of its 3 rows", "name the column"],
    ),
]

SOUND: list[tuple] = [
    force(cautions.clipped_sensor, NOISY, newton(2.0)),
    force(cautions.clipped_sensor, NOISY, None),
    (cautions.clipped_sensor, RISE, None, "displacement", "m"),
    (cautions.clipped_sensor, -RISE, None, "displacement", "m"),
    force(cautions.clipped_sensor, COARSE, None),
    force(cautions.clipped_sensor, COARSE_STEP, None),
    force(cautions.clipped_sensor, np.clip(NOISY, -0.5, 0.9), newton(2.0)),
    force(cautions.coarse_quantisation, MOSTLY_CLIPPED, None, None),
    force(cautions.coarse_quantisation, NOISY, newton(1e-4), newton(1e-3)),
    force(cautions.coarse_quantisation, NOISY, None, None),
    (checks.less_than_noise, np.full(9, 0.5), newton(1e-3), "force"),
    (cautions.sampling_jitter, TIME),
    (cautions.sampling_jitter, np.append(TIME, TIME[-1] + 0.001)),
    (cautions.current_at_limit, CURRENT, 0.2, "creep"),
    (checks.constant_channel, np.array([1.0, 1.0, 1.001]), "force"),
    (checks.outside_range, np.array([-0.5, 0.5]), newton(0.5), "force", 1e-9),
    (checks.not_finite, NOISY, "force"),
    (checks.time_goes_back, TIME),
    (checks.time_repeats, TIME),
]


def messages(check: Callable[..., None], *arguments: object) -> list[str]:
    report = Report("a.csv")
    check(report, *arguments)
    return report.faults + report.warnings


@pytest.mark.parametrize(("call", "words"), REPORTED)
def test_a_wrong_channel_is_reported(call: tuple, words: list[str]) -> None:
    (message,) = messages(*call)
    assert message.startswith("a.csv")
    for word in words:
        assert word in message


@pytest.mark.parametrize("call", SOUND)
def test_a_sound_channel_is_not_reported(call: tuple) -> None:
    assert messages(*call) == []
