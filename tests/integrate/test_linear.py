import decimal

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deabayes.integrate.linear import SMALL_STEP, _weights, hold, relaxation_response


def respond(load, tau, compliance=None, instantaneous=0.0):
    tau = np.atleast_2d(tau)
    compliance = np.ones_like(tau) if compliance is None else np.atleast_2d(compliance)
    return relaxation_response(load, np.full(len(tau), instantaneous), compliance, tau)


@pytest.mark.parametrize("z", [1e-14, 1e-8, 1e-3, 0.1, 0.4999, SMALL_STEP, 0.51, 1.0, 7.0, 700.0])
def test_step_weights_match_exact_arithmetic(z):
    with decimal.localcontext(prec=80):
        exact_z = decimal.Decimal(float(z))
        decay = (-exact_z).exp()
        psi_0 = 1 - decay
        psi_1 = 1 - psi_0 / exact_z
        exact = [float(value) for value in (decay, psi_0, psi_1, 1 - 2 * psi_1 / exact_z)]
    assert _weights(z) == pytest.approx(exact, rel=1e-14, abs=1e-300)


def test_step_ramp_and_parabola_in_closed_form():
    time = np.linspace(0.0, 3.0, 301)
    tau = 0.7
    grown = -np.expm1(-time / tau)
    step = respond(hold([0.0], [2.0], time), tau)[0]
    assert step[1:] == pytest.approx(2.0 * grown[1:], rel=1e-12)
    ramp = respond(hold([0.0, 3.0], [0.0, 3.0], time), tau)[0]
    assert ramp == pytest.approx(time - tau * grown, rel=1e-11, abs=1e-13)
    parabola = respond(hold([0.0, 3.0], [0.0, 3.0], time, power=2), tau)[0]
    expected = time**2 - 2 * tau * time + 2 * tau**2 * grown
    assert parabola == pytest.approx(expected, rel=1e-11, abs=1e-13)


def test_jittered_samples_far_from_zero_keep_their_own_lengths():
    """Lengths a rounding apart each, whose chain spans more than half a sampling interval."""
    rng = np.random.default_rng(3)
    time = 1.7e9 + np.cumsum(1e-4 * (1.0 + 0.3 * rng.uniform(-1.0, 1.0, 5000)))
    load = hold([time[0]], [1.0], time)
    resolution = 4.0 * np.finfo(float).eps * time[-1]
    found = load.lengths[load.length_index]
    assert np.max(np.abs(found - np.diff(time))) <= resolution
    even = hold([0.0], [1.0], 1e4 + 1e-4 * np.arange(5000))
    assert even.lengths.size == 2


def test_a_small_first_step_keeps_its_relative_accuracy():
    step = respond(hold([0.0], [1.0], np.array([1e-12, 1e-9])), 0.12)[0]
    assert step == pytest.approx(-np.expm1(-np.array([1e-12, 1e-9]) / 0.12), rel=1e-12)


def test_a_history_of_ramps_and_jumps_matches_a_general_solver():
    knots = np.array([0.1, 0.1, 0.35, 0.35, 0.8, 1.0])
    values = np.array([0.0, 1.5, 0.4, -1.0, 2.0, 0.5])
    time = np.linspace(0.0, 1.4, 57)
    tau = 0.2
    got = respond(hold(knots, values, time, power=2), tau)[0]

    state, expected = 0.0, np.zeros_like(time)
    pieces = [(knots[i], knots[i + 1], values[i], values[i + 1]) for i in (1, 3, 4)]
    for start, end, first, last in [*pieces, (1.0, 1.4, 0.5, 0.5)]:

        def slope(t, y, start=start, end=end, first=first, last=last):
            return (-y + (first + (last - first) * (t - start) / (end - start)) ** 2) / tau

        inside = (time >= start) & (time <= end)
        solution = solve_ivp(
            slope, (start, end), [state], method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True
        )
        expected[inside] = solution.sol(time[inside])[0]
        state = solution.y[0, -1]
    assert got == pytest.approx(expected, abs=1e-10)
    assert np.all(got[time < 0.1] == 0.0)


def test_outputs_take_the_value_after_a_jump_and_any_order():
    load = hold([1.0, 1.0, 2.0], [0.0, 3.0, 3.0], np.array([2.5, 0.5, 1.0]), power=2)
    assert load.input.tolist() == [9.0, 0.0, 9.0]
    response = respond(load, 0.5, instantaneous=2.0)[0]
    ascending = respond(hold([1.0], [3.0], np.array([0.5, 1.0, 2.5]), power=2), 0.5, None, 2.0)[0]
    assert response[[1, 2, 0]] == pytest.approx(ascending, rel=1e-14)


def test_an_even_grid_needs_one_step_length_and_does_not_drift():
    time = 0.02 + np.arange(5001) * 1e-4
    load = hold([0.02], [1.0], time)
    assert load.lengths.size == 1
    expected = -np.expm1(-(time - 0.02) / 0.12)
    assert respond(load, 0.12)[0][1:] == pytest.approx(expected[1:], rel=1e-10)


def test_a_draw_is_the_same_in_any_company():
    rng = np.random.default_rng(3)
    load = hold(np.sort(rng.uniform(size=20)), rng.normal(size=20), np.linspace(0, 1.2, 40), 2)
    tau = np.exp(rng.normal(size=(37, 3)) - 2)
    compliance = rng.lognormal(size=(37, 3))
    direct = rng.lognormal(size=37)
    together = relaxation_response(load, direct, compliance, tau)
    for order in (rng.permutation(37), np.arange(5), np.array([30])):
        alone = relaxation_response(load, direct[order], compliance[order], tau[order])
        assert np.array_equal(alone, together[order])


def test_a_failing_draw_is_nan_and_leaves_its_neighbours_alone():
    load = hold([0.0], [1.0], np.linspace(0.1, 1, 5))
    tau = np.array([[0.1], [-0.1], [np.nan], [0.0], [0.2]])
    response = relaxation_response(load, np.zeros(5), np.ones((5, 1)), tau)
    assert np.isnan(response).all(axis=1).tolist() == [False, True, True, True, False]
    assert np.array_equal(response[[0, 4]], respond(load, tau[[0, 4]]))


@pytest.mark.parametrize(
    ("knots", "values", "message"),
    [([1.0, 0.0], [0.0, 1.0], "ascend"), ([0.0], [0.0, 1.0], "equal"), ([0.0], [np.nan], "finite")],
)
def test_hold_refuses_malformed_histories(knots, values, message):
    with pytest.raises(ValueError, match=message):
        hold(knots, values, np.array([0.5]))
