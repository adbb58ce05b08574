"""Sobol' indices against closed forms, and what failed points do to them."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.prediction import influence

GROUPS = 4096


def rng():
    return np.random.default_rng(3)


def ishigami(u, a=7.0, b=0.1):
    """sin x1 + a sin^2 x2 + b x3^4 sin x1, x uniform on [-pi, pi] (Ishigami & Homma 1990)."""
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_indices(a=7.0, b=0.1):
    one = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2
    two = a * a / 8.0
    both = 8.0 * b * b * np.pi**8 / 225.0
    total = one + two + both
    return np.array([one, two, 0.0]) / total, np.array([one + both, two, both]) / total


def within(found, conf, exact):
    """A 95 % half-width is two standard errors: four of them, and rounding."""
    np.testing.assert_array_less(np.abs(found - exact), 2.0 * conf + 1e-9)


def test_ishigami():
    points = influence.design(3, GROUPS, rng())
    assert points.shape == (GROUPS * 5, 3)
    found = influence.indices(ishigami(points), 3, rng())
    first, total = ishigami_indices()
    within(found.first_order, found.first_order_conf, first)
    within(found.total, found.total_conf, total)
    np.testing.assert_allclose(found.first_order, first, atol=0.01)
    np.testing.assert_allclose(found.total, total, atol=0.01)
    assert np.all(found.total_conf < 0.05)
    assert (found.groups, found.left_out) == (GROUPS, 0)


def test_an_additive_function_has_equal_first_and_total_indices():
    from scipy.special import ndtri

    weights = np.array([1.0, 2.0, 0.0, 3.0])
    points = influence.design(4, GROUPS, rng())
    found = influence.indices(5.0 + ndtri(points) @ weights, 4, rng())
    exact = weights**2 / np.sum(weights**2)
    np.testing.assert_allclose(found.first_order, exact, atol=0.01)
    np.testing.assert_allclose(found.total, exact, atol=0.01)
    assert found.first_order[2] == found.total[2] == 0.0


def test_intervals_cover_the_truth():
    """Of 95 % intervals of random repeats, at least 80 % cover: they err on the wide side."""
    first, _ = ishigami_indices()
    covered = []
    for seed in range(40):
        own = np.random.default_rng(seed)
        points = influence.design(3, 256, own)
        found = influence.indices(ishigami(points), 3, own)
        covered.append(np.abs(found.first_order - first) <= found.first_order_conf)
    assert np.mean(covered, axis=0)[:2].min() >= 0.8


def test_a_failed_point_takes_its_group_with_it():
    points = influence.design(3, GROUPS, rng())
    values = ishigami(points)
    values[[0, 1, 7]] = np.nan
    found = influence.indices(values, 3, rng())
    assert found.left_out == 2
    kept = influence.indices(values[10:], 3, rng())
    np.testing.assert_array_equal(found.first_order, kept.first_order)


@pytest.mark.parametrize("values", [np.ones(50), np.full(50, np.nan)])
def test_nothing_to_explain(values):
    assert influence.indices(values, 3, rng()) is None


def test_same_seed_same_design():
    np.testing.assert_array_equal(influence.design(3, 64, rng()), influence.design(3, 64, rng()))
