"""When a step happens and where cycles start, and curves read between a record's points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit import structure_contexts
from tests.unit.contexts import experiment
from tests.unit.membranes import sine, step, voltage

from deabayes.analyses.drive import Cycles, amplitude, resampled, since_step


def test_a_step_starts_where_the_voltage_leaves_its_first_value():
    ramp = voltage([0.0, 4.9, 5.0, 5.3, 600.0], [0.3, -0.3, 0.2, 4000.0, 4000.3])
    assert ramp.onset == 5.0
    assert step(4e3).onset == 0.0
    assert amplitude(ramp) == 4000.3
    record = experiment("step", "step", ramp, np.linspace(0.0, 20.0, 5), "stretch")
    np.testing.assert_allclose(since_step(record), [-5.0, 0.0, 5.0, 10.0, 15.0])


def sine_record(rest=5.0, periods=4, frequency=0.05, spacing=0.5):
    driven = sine(frequency, periods)
    times = np.r_[0.0, driven.coordinate + rest]
    driven = voltage(times, np.r_[0.0, driven.values])
    return experiment("sine", "sine", driven, np.arange(0.0, times[-1], spacing), "displacement")


def test_cycles_start_where_the_sine_starts():
    cycles = Cycles.of(sine_record())
    assert cycles.period == pytest.approx(20.0, rel=1e-4)
    assert cycles.frequency == pytest.approx(0.05, rel=1e-4)
    np.testing.assert_allclose(cycles.starts, [5.0, 25.0, 45.0, 65.0], atol=2e-3)
    times = cycles.times(4)
    assert times.shape == (4, 5)
    np.testing.assert_allclose(times[1], [25.0, 30.0, 35.0, 40.0, 45.0], atol=2e-3)


def test_noise_on_the_voltage_makes_no_cycles():
    record = sine_record()
    rng = np.random.default_rng(1)
    values = record.excitation.values + 0.3 * rng.standard_normal(record.excitation.values.size)
    noisy = voltage(record.excitation.coordinate, values)
    record = experiment("sine", "sine", noisy, record.coordinate, "displacement")
    np.testing.assert_allclose(Cycles.of(record).starts, [5.0, 25.0, 45.0, 65.0], atol=0.01)


def test_a_record_without_two_periods_has_no_cycles():
    assert Cycles.of(sine_record(periods=1)).starts.size == 0


def test_an_unfinished_cycle_does_not_count():
    record = sine_record()
    short = experiment("sine", "sine", record.excitation, record.coordinate[:150], "displacement")
    assert Cycles.of(short).starts.size == 3


def test_peaks_are_read_between_points():
    coordinate = np.arange(0.0, 41.0, 1.6)
    curves = np.stack([np.sin(2 * np.pi * coordinate / 20.0), coordinate])
    times = np.array([[5.0, 15.0], [25.0, 35.0]])
    found = resampled(coordinate, curves, times)
    assert found.shape == (2, 2, 2)
    np.testing.assert_allclose(found[0], [[1.0, -1.0], [1.0, -1.0]], atol=2e-3)
    np.testing.assert_allclose(found[1], times)


def test_a_sine_of_one_sign_starts_at_its_lowest_voltage():
    record = structure_contexts.sine(5.0, 2.0)
    found = Cycles.driven(record.excitation)
    assert found.period == pytest.approx(0.5, rel=1e-4)
    assert found.starts[0] == pytest.approx(structure_contexts.START, abs=2e-3)


def test_cycles_that_the_preparation_left_out_do_not_count():
    record = structure_contexts.sine(5.0, 5.0)
    found = Cycles.of(record)
    assert list(found.numbers) == [1, 2, 3, 4, 5, 8, 13]
    np.testing.assert_allclose(found.starts, 0.19 + 0.2 * (found.numbers - 1))
    # Without the history the excitation alone tells, and the gaps have no points all the same.
    assert set(Cycles.of(replace(record, steps=())).numbers) <= {1, 2, 3, 4, 5}
    kept = np.abs(record.coordinate - 0.19 - 1.5 * 0.2) > 0.045
    holed = replace(record, coordinate=record.coordinate[kept], response=record.response[kept])
    assert list(Cycles.of(holed).numbers) == [1, 3, 4, 5, 8, 13]


def test_points_beyond_a_gap_do_not_matter():
    coordinate = np.r_[np.arange(10.0), np.arange(50.0, 60.0)]
    values = np.where(coordinate < 20.0, np.sin(coordinate), 1e3)
    inside = np.array([[8.7, 9.4], [50.5, 59.0]])
    found = resampled(coordinate, values, inside)
    np.testing.assert_allclose(found[0], resampled(coordinate[:10], values[:10], inside[0]))
    np.testing.assert_allclose(found[1], 1e3)
