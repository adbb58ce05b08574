"""Steps and cycles of a record, and curves read between its points and along a sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared import structure_contexts
from tests.shared import structure_contexts as made_up
from tests.shared.contexts import experiment
from tests.shared.membranes import sine, step, voltage

from deabayes.integrate.periodic import upward_crossings
from deabayes.papers import timing
from deabayes.papers.timing import Cycles, Sweep, amplitude, resampled, since_step
from deabayes.systems.curves import drive_of


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


@pytest.mark.parametrize("volts", [(-2000.0, 2000.0), (500.0, 5000.0), (-5000.0, -500.0)])
def test_a_noisy_monitor_makes_no_cycles_of_a_densely_sampled_sine(volts):
    """50 cycles of 1 Hz at 1 kHz, of which noise alone crosses any level hundreds of times."""
    low, high = volts
    time = np.arange(0.0, 50.0, 1e-3)
    wave = np.sin(2.0 * np.pi * (time - (0.0 if low == -high else np.sign(high + low) * 0.25)))
    clean = 0.5 * (high + low) + 0.5 * (high - low) * wave
    noise = 0.02 * (high - low) * np.random.default_rng(2).standard_normal(time.size)
    found = Cycles.driven(voltage(time, clean + noise))
    assert found.starts.size == 50
    assert found.frequency == pytest.approx(1.0, rel=1e-4)
    np.testing.assert_allclose(found.starts, np.arange(50.0), atol=0.02)
    record = experiment("sine", "sine", voltage(time, clean + noise), time, "displacement")
    assert drive_of(record)[1] == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("turns", [0.0, 0.25, 0.4])
def test_crossings_without_noise_are_those_of_the_lines(turns):
    time = np.linspace(0.0, 9.0, 181)
    drive = np.sin(2.0 * np.pi * (time - turns))
    found = upward_crossings(time, drive, 0.5)
    np.testing.assert_allclose(np.interp(found, time, drive), 0.5, atol=1e-12)
    assert found.size == 9


def test_a_small_sine_about_a_large_bias_has_cycles():
    time = np.arange(0.0, 10.0, 1e-2)
    for bias in (4000.0, -4000.0):
        drive = voltage(time, bias - np.sign(bias) * 500.0 * np.cos(2.0 * np.pi * time))
        np.testing.assert_allclose(Cycles.driven(drive).starts, np.arange(10.0), atol=1e-3)


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


def test_amplitudes_along_a_sweep():
    record = made_up.sweep()
    swept = Sweep.of(record)
    growth = np.log(60.0) / 12.0
    turns = np.expm1(growth * (record.coordinate - made_up.START)) / growth
    frequency = np.exp(growth * (record.coordinate - made_up.START))
    size = 2e-3 + 1e-3 * np.exp(-((np.log(frequency / 30) / 0.2) ** 2))
    curve = 1e-3 * record.coordinate + size * np.cos(2 * np.pi * turns)
    found = swept.amplitude(np.stack([curve, 2.0 * curve]))
    expected = 4e-3 + 2e-3 * np.exp(-((np.log(swept.frequency / 30) / 0.2) ** 2))
    np.testing.assert_allclose(found[0], expected, rtol=0.05)
    np.testing.assert_allclose(found[1], 2.0 * found[0], rtol=1e-9)
    place, height = swept.resonance(found[0])
    assert place == pytest.approx(30.0, rel=0.05) and height == pytest.approx(6e-3, rel=0.05)
    assert np.isnan(swept.resonance(np.linspace(2.0, 1.0, swept.frequency.size))).all()


def test_frequencies_that_the_points_alias_are_left_out(monkeypatch):
    """At a third of the sampling rate the second harmonic reads as the first."""
    record = made_up.sweep(duration=40.0)
    found = Sweep.of(record).frequency
    monkeypatch.setattr(timing, "WORST_CONDITION", np.inf)
    (*_, missing) = sorted(set(Sweep.of(record).frequency) - set(found))
    assert missing == pytest.approx(125.0 / 3.0, abs=0.5)
    assert np.min(np.abs(found - missing)) > 0.3
