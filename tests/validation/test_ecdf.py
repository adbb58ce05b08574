"""The calibration check itself: uniform ranks pass, biased and narrow ones do not."""

import numpy as np

from tests.validation.ecdf import band, critical_tail, inside

POSSIBLE, SIZE = 100, 200


def test_uniform_ranks_pass_about_as_often_as_claimed():
    rng = np.random.default_rng(3)
    passed = [inside(rng.integers(0, POSSIBLE, SIZE), POSSIBLE) for _ in range(400)]
    assert 0.92 <= np.mean(passed) <= 0.98


def test_narrow_and_shifted_posteriors_fail():
    rng = np.random.default_rng(4)
    truth = rng.normal(size=SIZE)
    narrow = (rng.normal(scale=0.6, size=(SIZE, POSSIBLE - 1)) < truth[:, None]).sum(1)
    shifted = (rng.normal(loc=0.5, size=(SIZE, POSSIBLE - 1)) < truth[:, None]).sum(1)
    assert not inside(narrow, POSSIBLE)
    assert not inside(shifted, POSSIBLE)


def test_band_is_wider_than_pointwise():
    assert critical_tail(SIZE, POSSIBLE) < 0.05
    limits = band(SIZE, POSSIBLE)
    assert np.all(limits.lower <= limits.points) and np.all(limits.upper >= limits.points)
