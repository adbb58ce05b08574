"""A membrane's voltage history in pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.membranes import golden_draws, membrane, sine, voltage

from deabayes.integrate.drive import drive, scatter


def test_two_knots_stay_lines_and_a_first_value_is_a_jump():
    found = drive(np.array([0.0, 10.0]), np.array([4e3, 2e3]), -1.0, 20.0, 1e-7)
    np.testing.assert_array_equal(found.edges, [-1.0, 0.0, 10.0, 20.0])
    at = found.at(np.array([-1.0, -0.01, 0.0, 5.0, 10.0, 15.0, 20.0]))
    np.testing.assert_allclose(at, [0.0, 0.0, 4e3, 3e3, 2e3, 2e3, 2e3])
    np.testing.assert_array_equal(found.restart, [1, 1, 1])


def test_repeated_times_are_jumps():
    found = drive(np.array([0.0, 1.0, 1.0, 3.0]), np.array([0.0, 0.0, 5.0, 5.0]), 0.0, 3.0, 1e-7)
    np.testing.assert_array_equal(found.at(np.array([0.5, 0.999, 1.0, 2.0])), [0, 0, 5, 5])


@pytest.mark.parametrize("per_period", [200, 400, 2000])
def test_a_sampled_sine_is_followed_beyond_its_straight_lines(per_period):
    driven = sine(0.05, 5, per_period)
    found = drive(driven.coordinate, driven.values, 0.0, 100.0, 1e-6)
    time = np.linspace(0.0, 100.0, 3001)
    error = np.max(np.abs(found.at(time) - 2e3 * np.sin(0.1 * np.pi * time)))
    assert error < 2e-6 * 2e3
    assert len(found.edges) < 60
    assert found.restart.sum() == 1


@pytest.mark.parametrize("per_period", [40, 67, 100])
def test_a_coarsely_sampled_sine_is_followed_far_better_than_by_lines(per_period):
    driven = sine(0.05, 5, per_period)
    found = drive(driven.coordinate, driven.values, 0.0, 100.0, 1e-7)
    time = np.linspace(0.0, 100.0, 3001)
    exact = 2e3 * np.sin(0.1 * np.pi * time)
    lines = np.max(np.abs(driven.at(time) - exact))
    assert np.max(np.abs(found.at(time) - exact)) < lines / 10
    assert len(found.edges) < 60


def test_a_triangle_keeps_its_corners():
    time = np.linspace(0.0, 40.0, 401)
    triangle = 2e3 * np.abs(time % 20.0 - 10.0) / 10.0
    found = drive(time, triangle, 0.0, 40.0, 1e-7)
    inside = np.linspace(0.0, 40.0, 1237)
    np.testing.assert_allclose(found.at(inside), np.interp(inside, time, triangle), atol=1e-3)
    assert len(found.edges) < 10
    few = drive(time[::100], triangle[::100], 0.0, 40.0, 1e-7)
    np.testing.assert_allclose(few.at(inside), np.interp(inside, time, triangle), atol=1e-9)


@pytest.mark.parametrize("hold", [1.0, 60.0, 1000.0])
def test_a_last_row_far_behind_dense_ones_is_reached_by_a_line(hold: float) -> None:
    time = np.append(np.linspace(0.0, 2.0, 201), 2.0 + hold)
    rise = np.minimum(2e3 * time / 2.0, 2e3)
    for volts in (rise, 2e3 * np.sin(np.pi * np.minimum(time, 2.25))):
        found = drive(time, volts, 0.0, 2.0 + hold, 1e-7)
        inside = np.linspace(2.0, 2.0 + hold, 301)
        np.testing.assert_allclose(found.at(inside), np.interp(inside, time, volts), atol=1e-3)


@pytest.mark.parametrize("missing", [25, 50, 100])
def test_where_a_monitor_dropped_out_the_voltage_is_linear(missing: int) -> None:
    driven = sine(0.05, 5, 100)
    kept = np.r_[0:130, 130 + missing : 501]
    found = drive(driven.coordinate[kept], driven.values[kept], 0.0, 100.0, 1e-7)
    time = np.linspace(0.0, 100.0, 3001)
    lines = np.interp(time, driven.coordinate[kept], driven.values[kept])
    assert np.max(np.abs(found.at(time) - lines)) < 2e-3 * 2e3


def test_the_voltage_before_the_first_knot_is_stated():
    time = np.linspace(0.0, 1.0, 201)
    found = drive(time, 5e3 * np.cos(2 * np.pi * time), -0.5, 1.0, 1e-7, before=5e3)
    np.testing.assert_allclose(found.at(np.array([-0.5, -0.01, 0.0])), 5e3, rtol=1e-6)
    np.testing.assert_array_equal(found.restart[1:], 0)


def test_noise_of_the_monitor_is_smoothed_not_followed():
    rng = np.random.default_rng(4)
    time = np.arange(4001) * 0.05
    exact = 2e3 * np.sin(0.1 * np.pi * time)
    noisy = exact + 0.5 * rng.standard_normal(time.size)
    assert scatter(time, noisy) == pytest.approx(0.5, rel=0.1)
    assert scatter(time, exact) < 1e-3
    found = drive(time, noisy, 0.0, 200.0, 1e-7, noisy=True)
    assert len(found.edges) < 150
    assert np.std(found.at(time) - exact) < 0.5
    draws = golden_draws({
        "mu_alpha_Pa": 35e3, "zeta_alpha_Pa_s": 1e5, "J_alpha": 110.0, "J_beta": 55.0,
        "mu_beta_Pa": [15e3], "zeta_beta_Pa_s": [6e4],
    }, 1)  # fmt: skip
    smooth, rough = (
        membrane("kv_gm_1").predict(driven, time, "stretch", draws)[0]
        for driven in (voltage(time, exact), replace(voltage(time, noisy), noisy=True))
    )
    assert np.max(np.abs(smooth - rough)) < 5e-4 * np.ptp(smooth)


@pytest.mark.parametrize("size", [0.001, 0.008])
def test_a_small_signal_on_a_bias_is_followed_where_it_is_no_monitor_s(size: float) -> None:
    time = np.linspace(0.0, 1.0, 501)
    levels = 2e3 * (1.0 + size * np.random.default_rng(1).choice([-1.0, 1.0], time.size))
    np.testing.assert_allclose(drive(time, levels, 0.0, 1.0, 1e-7).at(time), levels, atol=1e-9)
    smoothed = drive(time, levels, 0.0, 1.0, 1e-7, noisy=True)
    assert np.std(smoothed.at(time)) < 0.5 * np.std(levels)


@pytest.mark.parametrize("per_period", [33, 36, 40, 48, 53, 80])
def test_a_sine_is_smooth_to_its_end(per_period: int) -> None:
    time = np.arange(3 * per_period + 1) / per_period
    found = drive(time, 1e3 - 1e3 * np.cos(2.0 * np.pi * time), 0.0, 3.0, 1e-7)
    inside = np.linspace(0.0, 3.0, 2437)
    exact = 1e3 - 1e3 * np.cos(2.0 * np.pi * inside)
    cut_off_by_lines = 1e3 * (2.0 * np.pi / per_period) ** 2 / 8.0
    assert np.max(np.abs(found.at(inside) - exact)) < 0.1 * cut_off_by_lines


@pytest.mark.parametrize("held", [1, 2, 3])
def test_random_levels_are_no_noise(held):
    rng = np.random.default_rng(6)
    levels = np.repeat(2e3 * rng.random(80), held)
    time = np.arange(levels.size, dtype=float)
    found = drive(time, levels, 0.0, time[-1], 1e-7)
    inside = np.linspace(0.0, time[-1], 1237)
    np.testing.assert_allclose(found.at(inside), np.interp(inside, time, levels), atol=1.0)


@pytest.mark.parametrize("half", [3, 4, 6])
def test_a_triangle_of_few_knots_keeps_its_corners(half):
    time = np.arange(241.0)
    volts = 2e3 * np.abs((time / half) % 2.0 - 1.0)
    found = drive(time, volts, 0.0, 240.0, 1e-7)
    inside = np.linspace(0.0, 240.0, 1237)
    np.testing.assert_allclose(found.at(inside), np.interp(inside, time, volts), atol=1.0)


def test_a_recorded_step_restarts_at_its_edges_only():
    rng = np.random.default_rng(5)
    time = np.arange(3001) * 0.2
    volts = np.where(time > 1.9, 4e3, 0.0) + 0.3 * rng.standard_normal(time.size)
    found = drive(time, volts, 0.0, 600.0, 1e-7, noisy=True)
    assert len(found.edges) < 40
    assert not found.varies
    assert 2 <= found.restart.sum() <= 6
