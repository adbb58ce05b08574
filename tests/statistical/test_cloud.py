"""Particles on their way: moves that leave a density alone, and rounds enough to reach its bulk."""

import numpy as np
import pytest
from scipy.special import ndtr

from deabayes.sampling.cloud import Cloud, Schedule
from deabayes.sampling.first_pass import WARM_UP_SCHEDULE
from deabayes.sampling.guide import Guide
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.smc import from_prior, log_standard_normal

TIMES = np.linspace(0.0, 320.0, 33)
CENTRE = np.array([0.5, 1.5, -1.0, 0.01, 0.02])


def two_rates(b):
    """b_1 + b_2 exp(-b_4 x) + b_3 exp(-b_5 x) for b (W, 5): (W, N)."""
    with np.errstate(over="ignore"):
        first, second = (b[:, k : k + 1] * np.exp(-TIMES * b[:, k + 2 : k + 3]) for k in (1, 2))
    return b[:, :1] + first + second


def test_particles_reach_the_bulk_where_the_noise_is_unknown():
    """The noise's sd may be anything from 1e-7 to 10: particles settle for a large one, where
    two rates are not told apart, and must leave that for a bulk that is a thousand times thinner.
    """
    truth = np.array([[0.375, 1.936, -1.465, 0.0129, 0.0221]])
    records = two_rates(truth) + 1e-3 * np.random.default_rng(1).standard_normal(TIMES.size)

    def log_likelihood(z):
        u = ndtr(z)
        b = CENTRE + 3 * (2 * u[:, :5] - 1) * np.abs(CENTRE)
        log_sigma = np.log(1e-7) + u[:, 5] * np.log(1e8)
        with np.errstate(over="ignore", invalid="ignore"):
            squares = ((two_rates(b) - records) ** 2).sum(axis=1)
            values = -0.5 * squares * np.exp(-2 * log_sigma) - TIMES.size * log_sigma
        return np.where(b[:, 3] < b[:, 4], values, -np.inf)

    found = from_prior(log_likelihood, 6, 256, np.random.default_rng(2), WARM_UP_SCHEDULE)
    residual = records - two_rates(truth)
    at_truth = -TIMES.size * (0.5 + 0.5 * np.log(np.mean(residual**2)))
    below = at_truth - np.median(found.log_increment)
    assert -3.0 < below < 3.0
    assert found.log_evidence > at_truth - 65.0


@pytest.mark.parametrize(("different", "halves"), [(200, 2), (8, 2), (7, 1), (1, 1)])
def test_copies_are_of_one_half_and_too_few_particles_of_one(different, halves):
    rng = np.random.default_rng(6)
    z = np.repeat(rng.standard_normal((different, 2)), 40, axis=0)
    cloud = Cloud(z, log_standard_normal, lambda z: np.zeros(len(z)), rng, Guide())
    assert len(cloud.proposals(Schedule(crossed=True))) == halves
    half = cloud._half.reshape(different, 40)
    assert (half == half[:, :1]).all()
    assert half.mean() == (0.5 if halves == 2 else 0.0)
    assert len(cloud.proposals(Schedule())) == 1


def banana(z):
    """A bent Gaussian's log density relative to N(0, I)'s: z_2 about z_0^2, width 0.1."""
    return -0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.1) ** 2 + 0.5 * z[:, 1] ** 2


def test_moves_along_a_map_leave_the_density_alone():
    rng = np.random.default_rng(3)
    first = rng.standard_normal(8000)
    z = np.column_stack([first, first**2 + 0.1 * rng.standard_normal(8000)])
    lines = fit(z, 2, rng).lines[0][1]
    cloud = Cloud(z.copy(), log_standard_normal, banana, rng, Guide())
    for _ in range(20):
        cloud._along(1.0, lines)
    assert np.mean(cloud.z != z) > 0.9
    width = cloud.z[:, 1] - cloud.z[:, 0] ** 2
    assert cloud.z[:, 0].mean() == pytest.approx(0.0, abs=4 / np.sqrt(8000))
    assert cloud.z[:, 0].var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 8000))
    assert width.mean() == pytest.approx(0.0, abs=0.4 / np.sqrt(8000))
    assert width.std() == pytest.approx(0.1, rel=4 / np.sqrt(16000))
