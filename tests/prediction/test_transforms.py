"""PIT of a record that the fit has not seen: uniform, however long, if the model is right."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.prediction.errors import uniformity_p
from deabayes.prediction.outcomes import transforms

CALIBRATED, HELD_OUT, DRAWS = 100, 1000, 500


def held_out(rng, draws=DRAWS):
    """Scores and log densities (S, N) of a level, known from 100 readings with noise of sd 1."""
    levels = rng.normal(size=draws) / np.sqrt(CALIBRATED)
    truth = rng.normal() / np.sqrt(CALIBRATED)
    scores = truth + rng.normal(size=HELD_OUT) - levels[:, None]
    return scores, -0.5 * scores**2


def rejected(weighted, repeats=100):
    """Share of right models that a test of the 5 % level calls wrong."""
    rng = np.random.default_rng(8)
    found = []
    for _ in range(repeats):
        scores, log_density = held_out(rng)
        found.append(uniformity_p(transforms(scores, log_density if weighted else None)))
    return np.mean(np.array(found) < 0.05)


def test_a_right_model_is_rejected_as_often_as_the_test_says():
    assert rejected(weighted=True) <= 0.11
    # With equal weights the level's one error counts at all thousand points.
    assert rejected(weighted=False) > 0.4


def test_weights_stay_where_too_few_draws_would_be_left():
    scores, log_density = held_out(np.random.default_rng(9))
    log_density[7, 500:] += 100.0  # from point 501 on, one draw alone
    found = transforms(scores, log_density)
    cut = transforms(scores[:, :501], log_density[:, :501])
    np.testing.assert_array_equal(found[:501], cut)
    before = np.sum(log_density[:, :500], axis=1)
    weights = np.exp(before - before.max())
    assert np.sum(weights) ** 2 / np.sum(weights**2) > 20.0
    alone = transforms(scores[7:8])
    assert np.abs(found[501:] - alone[501:]).max() > 0.01


def test_draws_without_a_density_do_not_count():
    scores, log_density = held_out(np.random.default_rng(10), draws=50)
    scores[3, 2] = np.nan
    log_density[4, 5] = -np.inf
    left = np.delete(np.arange(50), [3, 4])
    np.testing.assert_allclose(
        transforms(scores, log_density), transforms(scores[left], log_density[left])
    )
    assert np.isnan(transforms(np.full((2, 4), np.nan))).all()


@pytest.mark.parametrize("draws", [1, 2])
def test_a_draw_or_two_do(draws):
    scores, log_density = held_out(np.random.default_rng(11), draws=draws)
    assert np.isfinite(transforms(scores, log_density)).all()
