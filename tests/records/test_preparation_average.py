"""Averages over bins, and the samples they may hold."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.strip_records import curve, prepared, raw, relaxation


def test_average_is_an_honest_mean() -> None:
    rng = np.random.default_rng(3)
    clean = relaxation(end=1000.0)
    sigma = 1e-3
    noise = sigma * rng.standard_normal(clean.columns["time"].size)
    noisy = raw(
        clean.columns["time"], clean.columns["displacement"], clean.columns["force"] + noise
    )
    steps = ({"average": {"grid": "geometric", "first_width": "0.1 s", "widest": "20 s"}},)
    experiment, truth = prepared(noisy, *steps), prepared(clean, *steps)
    score = (experiment.response - truth.response) * np.sqrt(experiment.samples_averaged) / sigma
    assert np.var(score) == pytest.approx(1.0, abs=0.35)
    assert experiment.samples_averaged.sum() == clean.columns["time"].size
    # a mean over a curved stretch stands close to the curve
    curve_at = np.interp(truth.coordinate, clean.columns["time"], clean.columns["force"])
    assert np.abs(truth.response - curve_at).max() < 2e-3


def test_geometric_bins_restart_at_the_end_of_the_ramp() -> None:
    experiment = prepared(relaxation(), {"average": {"first_width": "0.1 s", "widest": "20 s"}})
    time = experiment.coordinate
    after = time[(time > 3.25) & (time < 3.8)]
    assert np.diff(after).max() < 0.2
    assert 15.0 < np.diff(time)[-2] < 20.5
    before = np.diff(time[(time > 1.2) & (time < 2.9)])
    assert before.max() <= 0.04 * 2.0 * 1.1  # 4 % of the ramp


def test_a_record_sampled_densely_at_first_is_not_smeared_there() -> None:
    """A lab's logarithmic sampling: its median interval is far longer than that of the ramp."""
    time = np.r_[np.linspace(0.0, 1.0, 21)[:-1], np.geomspace(1.0, 300.0, 120)]
    displacement = 0.08 * np.minimum(time, 1.0)
    force = np.where(time < 1.0, time, 0.5 + 0.5 * np.exp(-(time - 1.0) / 20.0))
    experiment = prepared(raw(time, displacement, force), {"average": {}})
    after = experiment.coordinate > 1.0
    curve_at = 0.5 + 0.5 * np.exp(-(experiment.coordinate[after] - 1.0) / 20.0)
    assert np.abs(experiment.response[after] - curve_at).max() < 2e-4


def test_excitation_travel_bounds_bins_despite_a_noisy_monitor() -> None:
    record = relaxation()
    noise = 1e-5 * np.random.default_rng(1).standard_normal(record.columns["time"].size)
    noisy = raw(
        record.columns["time"], record.columns["displacement"] + noise, record.columns["force"]
    )
    step = {"average": {"first_width": "0.1 s", "widest": "20 s"}}
    assert prepared(noisy, step).coordinate.size < 1.2 * prepared(record, step).coordinate.size


def test_no_bin_reaches_across_a_mask_or_a_jump() -> None:
    time = np.linspace(0.0, 10.0, 1001)
    displacement = np.where(time >= 5.0, 0.01, 0.0)
    force = np.where(time >= 5.0, 1.0, 0.0)
    force[(time > 7.0) & (time < 7.5)] = 9.0
    mask = {"crop": {"to": "7 s"}}
    for grid in ({"grid": "uniform", "points": 4}, {"grid": "geometric", "first_width": "0.9 s"}):
        experiment = prepared(
            raw(time, displacement, force), mask, {"average": grid}, protocol="step"
        )
        assert set(experiment.response.tolist()) <= {0.0, 1.0}
    ramp = raw(time, 0.001 * time, time)
    experiment = prepared(
        ramp, {"mask_ramp_end": {"at": "4.5 s", "before": "0.5 s", "after": "0.5 s"}},
        {"average": {"grid": "uniform", "width": "3 s"}}, protocol="load_unload",
    )  # fmt: skip
    middles = [1.495, 3.495, 5.5, 7.495, 9.5]  # the bin from 3 to 6 s is broken by the mask
    assert np.allclose(experiment.coordinate, middles, atol=0.02)


@pytest.mark.parametrize("cycles", [2, 10, 50])
@pytest.mark.parametrize("samples", [20, 200], ids=["sparse", "dense"])
@pytest.mark.parametrize("steps", [(), ({"excitation_knots": {}},)], ids=["raw", "knots"])
def test_straight_pieces_of_a_sine_are_no_jumps(
    cycles: int, samples: int, steps: tuple[object, ...]
) -> None:
    time = np.arange(0.0, cycles, 1.0 / samples)
    sine = raw(time, 0.02 * np.sin(2.0 * np.pi * time), time)
    average = {"average": {"grid": "uniform", "points": 35}}
    assert prepared(sine, *steps, average, protocol="sine").coordinate.size <= 36


def test_a_jump_before_a_sine_is_one() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    bias = np.where(time < 5.003, 0.0, 0.05 + 0.02 * np.sin(2.0 * np.pi * time))
    record = raw(time, bias, np.where(time < 5.003, 0.0, 1.0))
    for steps in ((), ({"excitation_knots": {}},)):
        average = {"average": {"grid": "uniform", "width": "7 s"}}
        assert set(prepared(record, *steps, average, protocol="sine").response) == {0.0, 1.0}


def test_uniform_leaves_a_sparse_record_alone() -> None:
    stretch = np.linspace(1.0, 7.0, 24)
    experiment = curve(stretch, stretch**2, {"average": {"grid": "uniform", "points": 70}})
    assert np.array_equal(experiment.coordinate, stretch)
