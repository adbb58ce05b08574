"""Left-out blocks and records against closed forms of a linear Gaussian model."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from deabayes.comparison.decision import leave_one_block_out
from deabayes.comparison.left_out import left_out_log_density, log_ratio_without

POINTS, BLOCKS, SIGMA = 24, 8, 0.5


def line(outlier=0.0):
    """z ~ N(0, I) of a line's level and slope, and data about it, one block of them moved."""
    rng = np.random.default_rng(3)
    design = np.column_stack([np.ones(POINTS), np.linspace(-1.0, 1.0, POINTS)])
    data = design @ [0.4, -0.7] + SIGMA * rng.normal(size=POINTS)
    data[-3:] += outlier
    return design, data


def of_block(block):
    return slice(3 * block, 3 * block + 3)


def posterior(design, data):
    precision = np.eye(2) + design.T @ design / SIGMA**2
    covariance = np.linalg.inv(precision)
    return covariance @ design.T @ data / SIGMA**2, covariance


def log_densities(design, data, z):
    """(S, N)"""
    return norm(z @ design.T, SIGMA).logpdf(data)


def exact(design, data, block):
    """log p(block | the others)."""
    kept = np.ones(POINTS, bool)
    kept[of_block(block)] = False
    mean, covariance = posterior(design[kept], data[kept])
    left = design[~kept]
    spread = left @ covariance @ left.T + SIGMA**2 * np.eye(3)
    return float(multivariate_normal(left @ mean, spread).logpdf(data[~kept]))


def blocks_of(pointwise):
    return pointwise.reshape(len(pointwise), BLOCKS, 3).sum(axis=2)


def test_importance_weights_leave_a_block_out():
    design, data = line()
    rng = np.random.default_rng(1)
    z = rng.multivariate_normal(*posterior(design, data), size=20000)
    terms = blocks_of(log_densities(design, data, z))
    found = leave_one_block_out(terms)
    wanted = [exact(design, data, block) for block in range(BLOCKS)]
    assert np.all(found.k_hat < 0.7)
    np.testing.assert_allclose(found.terms, wanted, atol=0.05)
    assert found.elpd < np.log(np.mean(np.exp(terms), axis=0)).sum(), "better than in the fit"


def test_a_block_that_the_others_do_not_expect_is_said_to_be_unreliable_and_is_sampled():
    design, data = line(outlier=4.0)
    rng = np.random.default_rng(2)
    z = rng.multivariate_normal(*posterior(design, data), size=1000)
    found = leave_one_block_out(blocks_of(log_densities(design, data, z)))
    last, wanted = BLOCKS - 1, exact(design, data, BLOCKS - 1)
    assert found.k_hat[last] > 0.7
    assert found.terms[last] > wanted + 0.5, "weights would do"

    def log_left(z):
        return log_densities(design, data, z)[:, of_block(last)].sum(axis=1)

    def log_whole(z):
        return log_densities(design, data, z).sum(axis=1) - 0.5 * np.sum(z**2, axis=1)

    ratio, without = log_ratio_without(log_whole, log_left, z[:256], rng)
    assert -ratio == pytest.approx(wanted, abs=0.3)
    mean, _ = posterior(design[:-3], data[:-3])
    np.testing.assert_allclose(without.mean(axis=0), mean, atol=0.1)
    assert left_out_log_density(
        lambda z: log_whole(z) - log_left(z), log_left, z[:256], rng
    ) == pytest.approx(wanted, abs=0.3)


def test_draws_that_cannot_have_what_is_left_out_count():
    """z ~ N(0, 1); what is left out is impossible below 0.5 and indifferent above."""
    rng = np.random.default_rng(4)
    z = rng.normal(size=(4000, 1))
    z = z[z[:, 0] > 0.5][:512]
    found = left_out_log_density(
        lambda z: -0.5 * z[:, 0] ** 2,
        lambda z: np.where(z[:, 0] > 0.5, 0.0, np.nan),
        z,
        rng,
    )
    assert found == pytest.approx(norm.logsf(0.5), abs=0.2)
