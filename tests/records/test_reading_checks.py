"""The tiny checks: each speaks when it should and is silent when it should be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from deabayes.records import checks

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

SPEAKS: list[tuple[Callable[[], list[str]], list[str]]] = [
    (
        lambda: checks.clipped_sensor(NOISY, 0.9, "force", "N", "a.csv"),
        ["column force", "range of 900 mN"],
    ),
    (
        lambda: checks.clipped_sensor(CLIPPED, None, "force", "N", "a.csv"),
        ["largest value 800 mN", "held"],
    ),
    (
        lambda: checks.clipped_sensor(-CLIPPED, None, "force", "N", "a.csv"),
        ["smallest value -800 mN"],
    ),
    (
        lambda: checks.clipped_sensor(MOSTLY_CLIPPED, None, "force", "N", "a.csv"),
        ["largest value 1 N is held for 175 samples in a row (88% of all)", "clipped"],
    ),
    (
        lambda: checks.clipped_sensor(np.clip(NOISY, -0.5, 0.9), 2.0, "force", "N", "a")[1:],
        ["smallest value -500 mN"],
    ),
    (
        lambda: checks.coarse_quantisation(COARSE_STEP, None, None, "force", "N", "a"),
        ["steps of 200 mN"],
    ),
    (
        lambda: checks.clipped_sensor(np.minimum(RISE, 0.9), None, "force", "N", "a"),
        ["value 900 mN"],
    ),
    (
        lambda: checks.clipped_sensor(np.maximum(NOISY, 0.1), None, "force", "N", "a"),
        ["value 100 mN"],
    ),
    (
        lambda: checks.coarse_quantisation(COARSE, None, None, "force", "N", "a.csv"),
        ["steps of 200 mN"],
    ),
    (
        lambda: checks.coarse_quantisation(NOISY, 1e-2, 1e-3, "force", "N", "a.csv"),
        ["resolution 10 mN", "noise 1 mN"],
    ),
    (lambda: checks.sampling_jitter(JITTERED, "a.csv"), ["jitter", "10%", "0.02 s"]),
    (lambda: checks.sampling_jitter(GAP, "a.csv"), ["gap of 3.02 s after 2 s"]),
    (lambda: checks.current_at_limit(CURRENT, 0.12, "creep", "a.csv"), ["120 mA", "12.50%"]),
    (lambda: checks.current_at_limit(CURRENT, 0.12, "sine", "a.csv"), ["distorted"]),
    (lambda: checks.shorter_than_time_constant(4.0, 500.0, "a.csv"), ["4 s", "500 s", "prior"]),
    (lambda: checks.too_few_points(5, 7, "study a, kv_gm_3"), ["5 points", "7 parameters", "give"]),
    (lambda: checks.too_few_points(7, 7, "a"), ["7 points"]),
    (lambda: checks.not_positive(np.array([1.0, 0.0]), "stretch", "a"), ["data row 2", "offset"]),
    (lambda: checks.not_positive(np.array([1.0, -40.0]), "gain", "a"), ["is -40", "no decibels"]),
    (lambda: checks.not_positive(np.array([0.0, 1.0]), "frequency", "a"), ["remove the row"]),
    (
        lambda: checks.not_finite(np.array([1.0, np.nan, np.inf, 1.0, np.nan]), "force", "a.csv"),
        ["infinite: 3", "data row 2", "a run of 2"],
    ),
    (
        lambda: checks.not_finite(np.array([1.0, np.nan, np.nan]), "force", "a.csv"),
        ["infinite: 2", "a run of 2"],
    ),
    (
        lambda: checks.not_finite(np.full(3, np.nan), "phase", "a.csv"),
        ["column phase", "no value in any of its 3 rows", "name the column"],
    ),
]

SILENT: list[Callable[[], list[str]]] = [
    lambda: checks.clipped_sensor(NOISY, 2.0, "force", "N", "a"),
    lambda: checks.clipped_sensor(NOISY, None, "force", "N", "a"),
    lambda: checks.clipped_sensor(RISE, None, "displacement", "m", "a"),
    lambda: checks.clipped_sensor(-RISE, None, "displacement", "m", "a"),
    lambda: checks.clipped_sensor(COARSE, None, "force", "N", "a"),
    lambda: checks.clipped_sensor(COARSE_STEP, None, "force", "N", "a"),
    lambda: checks.coarse_quantisation(MOSTLY_CLIPPED, None, None, "force", "N", "a"),
    lambda: checks.less_than_noise(np.full(9, 0.5), 1e-3, "force", "N", "a"),
    lambda: checks.coarse_quantisation(NOISY, 1e-4, 1e-3, "force", "N", "a"),
    lambda: checks.coarse_quantisation(NOISY, None, None, "force", "N", "a"),
    lambda: checks.sampling_jitter(TIME, "a"),
    lambda: checks.sampling_jitter(np.append(TIME, TIME[-1] + 0.001), "a"),
    lambda: checks.current_at_limit(CURRENT, 0.2, "creep", "a"),
    lambda: checks.shorter_than_time_constant(500.0, 400.0, "a"),
    lambda: checks.too_few_points(8, 7, "a"),
    lambda: checks.constant_channel(np.array([1.0, 1.0, 1.001]), "force", "a"),
    lambda: checks.outside_range(np.array([-0.5, 0.5]), 0.5, "displacement", "m", "a"),
    lambda: checks.not_finite(NOISY, "force", "a"),
    lambda: checks.time_goes_back(TIME, "a") + checks.time_repeats(TIME, "a"),
]


@pytest.mark.parametrize(("check", "words"), SPEAKS)
def test_speaks(check: Callable[[], list[str]], words: list[str]) -> None:
    sentences = check()
    assert len(sentences) == 1
    for word in words:
        assert word in sentences[0]


@pytest.mark.parametrize("check", SILENT)
def test_is_silent(check: Callable[[], list[str]]) -> None:
    assert check() == []
