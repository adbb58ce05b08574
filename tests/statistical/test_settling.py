"""When walkers have settled: means and spreads of two rounds, told from chance."""

import numpy as np
import pytest

from deabayes.sampling.start import SETTLED_TIMES, Round

WALKERS, DIMENSION = 32, 14


def round_of(rng, before=(), centre=0.0, spread=1.0, level=0.0, steps=10, held=1):
    """A round of steps, each held for a while; the first coordinate is moved and stretched."""
    chain = rng.standard_normal((steps // held, WALKERS, DIMENSION)).repeat(held, axis=0)
    chain[..., 0] = centre + spread * chain[..., 0]
    return Round.of(chain, level + rng.standard_normal(steps * WALKERS), before)


def rounds_of(rng, *changes):
    """Rounds one after the other, each with its changes."""
    rounds = []
    for change in changes:
        rounds.append(round_of(rng, rounds, **change))
    return rounds


def test_rounds_of_one_distribution_are_steady():
    """28 comparisons of 14 coordinates, ten autocorrelation times of 32 walkers in each round."""
    rng = np.random.default_rng(1)
    assert np.mean([rounds_of(rng, {}, {}, {})[-1].settled for _ in range(200)]) > 0.9


@pytest.mark.parametrize(
    "changes",
    [
        ({"spread": 0.5}, {"spread": 0.7}, {"spread": 1.0}),
        ({"spread": 2.0}, {"spread": 1.4}, {"spread": 1.0}),
        ({"centre": -0.6}, {"centre": -0.3}, {}),
        ({"level": -1.0}, {"level": -0.5}, {}),
    ],
    ids=["creeps outwards", "draws together", "wanders", "climbs"],
)
def test_rounds_that_change_are_not(changes):
    rng = np.random.default_rng(2)
    assert np.mean([rounds_of(rng, *changes)[-1].steady for _ in range(50)]) < 0.1


def test_short_rounds_are_not_enough():
    rng = np.random.default_rng(3)
    last = rounds_of(rng, *[{"steps": 12, "held": 2}] * 3)[-1]
    assert last.times < SETTLED_TIMES
    assert not last.settled


def test_two_rounds_tell_nothing():
    assert not rounds_of(np.random.default_rng(4), {}, {})[-1].steady
