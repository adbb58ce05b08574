import numpy as np
import pytest

from deabayes.prediction.errors import (
    crps,
    draws_behind_joint_log_score,
    interval_coverage,
    joint_log_score,
    relative_maximum_error,
    relative_rms_error,
)

OBSERVED = np.array([1.0, 2.0, 5.0])


def test_relative_errors_by_hand():
    predicted = np.array([[1.0, 4.0, 5.0], [0.0, 2.0, 8.0]])
    # residuals 0 -2 0 and 1 0 -3 over a range of 4
    assert relative_maximum_error(OBSERVED, predicted) == pytest.approx([2 / 4, 3 / 4])
    expected = [np.sqrt(4 / 3) / 4, np.sqrt(10 / 3) / 4]
    assert relative_rms_error(OBSERVED, predicted) == pytest.approx(expected)


def test_relative_errors_of_one_curve_are_scalars_and_nan_stays_in_its_row():
    assert relative_maximum_error(OBSERVED, OBSERVED + 1.0).shape == ()
    predicted = np.array([[1.0, np.nan, 5.0], [1.0, 2.0, 5.0]])
    for measure in (relative_maximum_error, relative_rms_error):
        assert np.isnan(measure(OBSERVED, predicted)).tolist() == [True, False]


@pytest.mark.parametrize("measure", [relative_maximum_error, relative_rms_error])
def test_relative_errors_refuse_constant_records_and_other_lengths(measure):
    with pytest.raises(ValueError, match="vary"):
        measure(np.ones(3), OBSERVED)
    with pytest.raises(ValueError, match="length"):
        measure(OBSERVED, np.zeros((2, 1)))


def test_crps_by_hand():
    # |x - y| = 1, 1, 3 (mean 5/3); |x_i - x_j| = 2, 4, 2, so 16 over ordered pairs, / (2 * 3 * 2)
    assert crps([1.0], [[2.0], [0.0], [4.0]]) == pytest.approx([5 / 3 - 16 / 12])


def test_crps_matches_the_double_sum_and_shifts_with_the_data():
    rng = np.random.default_rng(1)
    samples, observed = rng.normal(size=(50, 4)), rng.normal(size=4)
    pairs = np.abs(samples[:, None] - samples[None]).sum(axis=(0, 1)) / (2 * 50 * 49)
    expected = np.abs(samples - observed).mean(axis=0) - pairs
    assert crps(observed, samples) == pytest.approx(expected, rel=1e-12)
    assert crps(observed + 1e6, samples + 1e6) == pytest.approx(expected, rel=1e-8)


def test_crps_is_unbiased_in_the_number_of_samples():
    # E CRPS(N(0, 1), y ~ N(0, 1)) = 1 / sqrt(pi)
    rng = np.random.default_rng(2)
    for size in (2, 5):
        score = crps(rng.normal(size=200_000), rng.normal(size=(size, 200_000))).mean()
        assert score == pytest.approx(1 / np.sqrt(np.pi), abs=0.01)
    with pytest.raises(ValueError, match="at least 2"):
        crps([0.0], [[1.0]])


def test_interval_coverage_by_hand():
    observed = np.array([0.04, 0.06, 0.94, 0.95])
    assert interval_coverage(observed, np.full(4, 0.05), np.full(4, 0.95)) == 0.75
    assert interval_coverage(observed, np.zeros(4), np.array([1.0, 0.05, 1.0, 1.0])) == 0.75
    with pytest.raises(ValueError, match="length"):
        interval_coverage(observed, [0.05], [0.95])


def test_joint_log_score_by_hand_and_without_underflow():
    assert joint_log_score(np.log([0.1, 0.3])) == pytest.approx(np.log(0.2))
    assert joint_log_score(np.log([0.1, 0.3]) - 1e4) == pytest.approx(np.log(0.2) - 1e4)
    assert joint_log_score([np.log(0.3), -np.inf]) == pytest.approx(np.log(0.15))
    assert joint_log_score([-np.inf, -np.inf]) == -np.inf


def test_draws_behind_the_joint_log_score_by_hand():
    assert draws_behind_joint_log_score(np.log([0.1, 0.3])) == pytest.approx(0.16 / 0.1)
    assert draws_behind_joint_log_score(np.full(7, -1e4)) == pytest.approx(7.0)
    assert draws_behind_joint_log_score([5e3, 0.0, -np.inf]) == pytest.approx(1.0)
    assert draws_behind_joint_log_score([-np.inf, -np.inf]) == 0.0


@pytest.mark.parametrize(
    ("dimension", "information", "carried", "low", "high"),
    [(7, 2.0, True, -1.0, 1.0), (20, 10.0, False, -200.0, -10.0)],
)
def test_a_joint_log_score_is_reliable_with_ten_effective_draws(
    dimension, information, carried, low, high
):
    """Posterior N(0, I) and a record that says `information` times as much of each parameter."""
    rng = np.random.default_rng(4)
    variance, off, draws = 1.0 + 1.0 / information, [], []
    for _ in range(40):
        read = np.sqrt(variance) * rng.standard_normal(dimension)
        apart = ((rng.standard_normal((1000, dimension)) - read) ** 2).sum(axis=1)
        density = 0.5 * (dimension * np.log(information) - information * apart)
        exact = -0.5 * (dimension * np.log(variance) + read @ read / variance)
        off.append(joint_log_score(density) - exact)
        draws.append(draws_behind_joint_log_score(density))
    assert (np.median(draws) > 10.0) == carried
    assert low < np.mean(off) < high
