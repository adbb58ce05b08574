"""The lanes' Rodas5P: stages against the plain method, measured order, step sizes."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.membranes import golden_draws, membrane, sine, step

from deabayes.integrate import arrow, rodas5p
from deabayes.integrate.drive import Drive
from deabayes.integrate.rosenbrock import transformed_coefficients
from deabayes.systems.membrane import kernel

DRAWS = golden_draws({
    "mu_alpha_Pa": 35e3, "zeta_alpha_Pa_s": 1e5, "J_alpha": 110.0, "J_beta": 55.0,
    "mu_beta_Pa": [15e3, 12e3], "zeta_beta_Pa_s": [6e4, 5e5],
}, 2)  # fmt: skip
VOLTS = np.array([500.0, 3000.0, -400.0, 100.0, -50.0, 20.0])


def flow(t, y, constants, units, span):
    """The membrane's right-hand side as equations.md writes it."""
    fluidity, modulus, inverse, sigma, gain = constants[arrow.OF_CONSTANTS :]
    lam, volts = y[0], np.polynomial.Polynomial(VOLTS)(t * span)
    total = gain * volts**2 * lam**3 + sigma
    total -= modulus * (lam - lam**-5) / (1 - (2 * lam**2 + lam**-4 - 3) * inverse)
    rates = []
    for (_, speed, mu, q, _), xi in zip(units, y[1:], strict=True):
        argument = 1 - (2 * lam**2 / xi**2 + lam**-4 * xi**4 - 3) * q
        total -= mu * (lam / xi**2 - lam**-5 * xi**4) / argument
        rates.append(speed * (lam**2 / xi**3 - lam**-4 * xi**3) / argument)
    return np.array([fluidity * total, *rates])


def plain_step(t, y, h, constants, units, span):
    """Rodas5P with a dense Jacobian from complex steps."""
    size = y.size
    a, c, weights = transformed_coefficients()
    tiny = 1e-30j
    columns = [flow(t, y + tiny * row, constants, units, span).imag / 1e-30 for row in np.eye(size)]
    drift = flow(t + tiny, y + 0j, constants, units, span).imag / 1e-30
    matrix = np.eye(size) / (rodas5p.GAMMA * h) - np.array(columns).T
    u = np.zeros((8, size))
    for i in range(8):
        right = flow(t + rodas5p.NODES[i] * h, y + a[i] @ u, constants, units, span)
        u[i] = np.linalg.solve(matrix, right + c[i] @ u / h + h * rodas5p.D[i] * drift)
    return y + weights @ u, u


@pytest.mark.parametrize("h", [0.01, 0.5, 40.0])
def test_a_step_is_that_of_the_plain_method(h):
    drive = Drive(np.array([0.0, 100.0]), VOLTS[np.newaxis], np.ones(1), 3170.0)
    constants, units = membrane("kv_gm_2")._material(DRAWS).constants(drive, 1e-6, np.array([6.0]))
    y = np.array([3.1, 3.05, 3.02])
    c = np.ones(kernel.STRETCH_ROWS * arrow.LANES)
    blocks = np.ones((2, kernel.UNIT_ROWS * arrow.LANES))
    lane = 5
    arrow._load(c, blocks, 0, lane, constants[0], units[0])
    for row, values in ((arrow.V0, VOLTS), (arrow.START, y[:1])):
        c[row + lane :: arrow.LANES][: len(values)] = values
    c[[row + lane for row in (arrow.ALLOWED, arrow.STEP, arrow.OFFSET, arrow.SPAN)]] = (
        1,
        h,
        0.2,
        0.01,
    )
    blocks[:, arrow.START + lane] = y[1:]
    kernel.step(c, blocks)
    end, u = plain_step(20.0, y, h, constants[0], units[0], 0.01)
    found = [block[arrow.ARGUMENT + lane] for block in (c, *blocks)]
    np.testing.assert_allclose(found, end, rtol=1e-12)
    error = np.abs(u[7]) @ [1.0, *units[0, :, 4]]
    assert c[arrow.ERROR + lane] == pytest.approx(error, rel=1e-6, abs=1e-15)
    dense, weights = c[arrow.K2 + lane :: arrow.LANES][:3], [rodas5p.H2, rodas5p.H3, rodas5p.H4]
    np.testing.assert_allclose(dense, weights @ u[:, 0], rtol=1e-9, atol=1e-14)


def test_error_falls_with_the_tolerance_as_the_order_says():
    """Order 5: error ~ tolerance while steps ~ tolerance^(-1/5)."""
    time = np.linspace(0.0, 100.0, 101)
    exact = membrane("kv_gm_2", 1e-13).predict(sine(0.05), time, "stretch", DRAWS)[0]
    errors, steps = [], []
    for tolerance in (1e-6, 1e-8, 1e-10):
        system = membrane("kv_gm_2", tolerance)
        # The same pieces of the voltage for all.
        history = membrane("kv_gm_2", 1e-13)._history(sine(0.05), time)
        found = system._followed(history, time, DRAWS)
        errors.append(np.max(np.abs(found.values[0] - exact)) / np.ptp(exact))
        steps.append(found.steps[0])
    assert errors[0] < 1e-6
    assert errors[2] < 1e-10
    free = [
        membrane("kv_gm_2", tol)._followed(
            membrane("kv_gm_2")._history(step(4e3), time), time, DRAWS
        ).steps[0]
        for tol in (1e-7, 1e-11)
    ]  # fmt: skip
    assert 10 ** (4 / 5) * 0.7 < free[1] / free[0] < 10 ** (4 / 5) * 1.5


def test_growth_grows_cuts_and_survives_nan():
    assert arrow.growth(0.0) == arrow.LARGEST_GROWTH
    assert arrow.growth(1.0) == pytest.approx(arrow.SAFETY)
    assert arrow.growth(10.0) == pytest.approx(arrow.SAFETY * 10 ** (-3 / 16))
    assert arrow.growth(np.nan) == arrow.growth(np.inf) == arrow.LARGEST_CUT


def test_steps_end_at_the_piece_and_leave_no_splinter():
    assert arrow.fitted_step(1.0, 10.0) == 1.0
    assert arrow.fitted_step(1.0, 1.04) == 1.04
    assert arrow.fitted_step(3.0, 2.0) == 2.0
    assert arrow.fitted_step(1.0, 1.2) == pytest.approx(0.66)
