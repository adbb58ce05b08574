"""Rodas5P's coefficients, its measured orders, and the step grids."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.integrate import rodas5p
from deabayes.integrate.drive import GridSettings, graded_grid, simplify
from deabayes.integrate.rosenbrock import (
    interpolate,
    size_factor,
    transformed_coefficients,
)

DENSE = np.array([rodas5p.H2, rodas5p.H3, rodas5p.H4])


def classical_coefficients():
    """alpha (8, 8), Gamma (8, 8), b (8,) and embedded b (8,) of the untransformed method.

    Hairer & Wanner, Solving ODEs II, section IV.7: A = alpha Gamma^-1,
    C = 1/gamma - Gamma^-1, m = b Gamma^-1.
    """
    a, c, weights = transformed_coefficients()
    gamma = np.linalg.inv(np.eye(8) / rodas5p.GAMMA - c)
    embedded = weights.copy()
    embedded[7] = 0.0
    return a @ gamma, gamma, weights @ gamma, embedded @ gamma


def order_conditions(b, alpha, beta):
    """Residuals by order (Hairer & Wanner II, table IV.7.1): beta = alpha + Gamma."""
    ones = np.ones(8)
    a, r = alpha @ ones, beta @ ones
    return {
        1: [b @ ones - 1],
        2: [b @ r - 1 / 2],
        3: [b @ a**2 - 1 / 3, b @ beta @ r - 1 / 6],
        4: [
            b @ a**3 - 1 / 4,
            b @ (a * (alpha @ r)) - 1 / 8,
            b @ beta @ a**2 - 1 / 12,
            b @ beta @ beta @ r - 1 / 24,
        ],
        5: [
            b @ a**4 - 1 / 5,
            b @ (a**2 * (alpha @ r)) - 1 / 10,
            b @ (alpha @ r) ** 2 - 1 / 20,
            b @ (a * (alpha @ a**2)) - 1 / 15,
            b @ (a * (alpha @ beta @ r)) - 1 / 30,
            b @ beta @ a**3 - 1 / 20,
            b @ beta @ (a * (alpha @ r)) - 1 / 40,
            b @ beta @ beta @ a**2 - 1 / 60,
            b @ beta @ beta @ beta @ r - 1 / 120,
        ],
    }


@pytest.mark.parametrize(("which", "order"), [("method", 5), ("embedded", 4)])
def test_order_conditions(which, order):
    alpha, gamma, b, embedded = classical_coefficients()
    weights = {"method": b, "embedded": embedded}[which]
    residuals = order_conditions(weights, alpha, alpha + gamma)
    for p in range(1, order + 1):
        np.testing.assert_allclose(residuals[p], 0.0, atol=2e-13, err_msg=f"order {p}")
    if which == "embedded":
        assert np.max(np.abs(residuals[5])) > 1e-5


def test_nodes_and_drifts_are_row_sums():
    alpha, gamma, _, _ = classical_coefficients()
    np.testing.assert_allclose(alpha.sum(axis=1), rodas5p.NODES, atol=1e-13)
    np.testing.assert_allclose(gamma.sum(axis=1), rodas5p.D, atol=1e-13)


def test_the_method_is_stable_and_damps_stiff_modes():
    alpha, gamma, b, _ = classical_coefficients()
    beta = alpha + gamma

    def growth(z):
        return abs(1 + z * b @ np.linalg.solve(np.eye(8) - z * beta, np.ones(8)))

    assert growth(-1e7) < 1e-5
    assert all(growth(1j * w) <= 1 + 1e-12 for w in np.geomspace(1e-2, 1e4, 60))


def rate(t, y):
    return np.array([y[1], (1 - y[0] ** 2) * y[1] - y[0] + np.sin(t)])


def jacobian(y):
    return np.array([[0.0, 1.0], [-2 * y[0] * y[1] - 1, 1 - y[0] ** 2]])


def step(t, y, h):
    """One step for the forced van der Pol oscillator: end, dense output."""
    a, c, weights = transformed_coefficients()
    matrix = np.eye(2) / (rodas5p.GAMMA * h) - jacobian(y)
    drift = np.array([0.0, np.cos(t)])
    u = np.zeros((8, 2))
    for i in range(8):
        right = (
            rate(t + rodas5p.NODES[i] * h, y + a[i] @ u) + c[i] @ u / h + h * rodas5p.D[i] * drift
        )
        u[i] = np.linalg.solve(matrix, right)
    return y + weights @ u, DENSE @ u


def exact(t_end):
    from scipy.integrate import solve_ivp

    return solve_ivp(rate, (0, t_end), [1.0, 0.5], rtol=1e-13, atol=1e-13, method="DOP853").y[:, -1]


def test_measured_order_of_the_dense_output():
    errors = []
    for h in (0.2, 0.1, 0.05):
        y = np.array([1.0, 0.5])
        end, k = step(0.0, y, h)
        middle = [interpolate(0.4, y[i], end[i], *k[:, i]) for i in (0, 1)]
        errors.append(np.max(np.abs(middle - exact(0.4 * h))))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 4.6), orders


def test_size_factor_grows_cuts_and_survives_nan():
    assert size_factor(0.0) > 1.0
    assert size_factor(1.0) < 1.0
    assert size_factor(np.nan) == size_factor(np.inf) == 0.1


def test_grid_meets_every_knot_and_restarts_at_kinks_only():
    settings = GridSettings()
    time = np.array([0.0, 4.0, 100.0, 200.0, 1804.0])
    value = np.array([1.0, 2.0, 2.0, 2.0, 2.0])
    grid = graded_grid(time, value, settings)
    steps = np.diff(grid)
    assert np.all(steps > 0)
    assert set(time) <= set(grid)
    first_after = steps[np.searchsorted(grid, time[:-1])]
    np.testing.assert_allclose(first_after[:2], settings.first_step, rtol=1e-9)
    assert np.all(first_after[2:] > 5.0)
    ramp = np.interp(grid, time, value)
    assert np.max(np.diff(ramp) / ramp[:-1]) < settings.increment * 1.3
    age = np.where(grid[:-1] < 4.0, grid[:-1], grid[:-1] - 4.0)
    allowed = settings.first_step + (settings.growth - 1) * age
    assert np.all(steps <= allowed * settings.growth + 1e-12)


def test_simplify_keeps_the_signal_within_tolerance():
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 10.0, 401)
    value = 2.0 + np.sin(time) + 1e-4 * rng.standard_normal(401)
    kept = simplify(time, value, 1e-3)
    assert list(kept[[0, -1]]) == [0, 400]
    assert kept.size < 150
    assert np.max(np.abs(np.interp(time, time[kept], value[kept]) - value)) <= 1e-3 * (1 + 1e-9)
    corner = simplify(np.arange(5.0), np.array([1.0, 2.0, 3.0, 3.0, 3.0]), 1e-12)
    np.testing.assert_array_equal(corner, [0, 2, 4])
