"""How fast excitations change: sines, ramps and steps with a known answer."""

from dataclasses import replace

import numpy as np
import pytest

from deabayes.experiment import Excitation, Experiment
from deabayes.prediction.calibrated import fastest


def experiment(knots, values, read, coordinate_name="time"):
    read = np.asarray(read, dtype=float)
    return Experiment(
        name="record",
        protocol="step",
        role="calibrate",
        coordinate_name=coordinate_name,
        coordinate_unit="s",
        coordinate=read,
        response_name="displacement",
        response_unit="m",
        response=np.zeros(read.size),
        samples_averaged=np.ones(read.size),
        excitation=Excitation("stretch", "1", np.asarray(knots, float), np.asarray(values, float)),
    )


@pytest.mark.parametrize("frequency", [0.01, 1.0, 60.0])
@pytest.mark.parametrize("mean", [0.0, 1500.0])
def test_a_sine_has_its_own_frequency(frequency, mean):
    time = np.linspace(0.0, 5.0 / frequency, 1001)
    values = mean + 1000.0 * np.sin(2.0 * np.pi * frequency * time)
    assert fastest(experiment(time, values, time)) == pytest.approx(frequency, rel=0.01)


def test_a_sweep_has_its_highest():
    time = np.linspace(0.0, 20.0, 20001)
    phase = 2.0 * np.pi * (time + 9.0 * time**2 / 40.0)
    found = fastest(experiment(time, np.sin(phase), time))
    assert found == pytest.approx(10.0, rel=0.02)


def test_noise_of_a_monitor_is_no_change():
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 100.0, 50001)
    values = 2000.0 * np.sin(2.0 * np.pi * 0.05 * time) + rng.normal(0.0, 20.0, time.size)
    assert fastest(experiment(time, values, time[::100])) == pytest.approx(0.05, rel=0.3)


def test_a_ramp_lasts():
    read = np.linspace(0.0, 40.0, 4001)
    found = fastest(experiment([0.0, 2.0, 40.0], [1.0, 3.0, 3.0], read))
    assert found == pytest.approx(np.arcsin(0.2) / (0.2 * np.pi * 2.0), rel=0.01)


def test_what_is_read_late_after_a_ramp_counts_from_its_last_part():
    ramp = experiment([0.0, 2.0, 9.0], [0.0, 1.0, 1.0], [0.0, 3.0, 4.0, 5.0])
    assert fastest(ramp) == pytest.approx(1.0 / (2.0 * np.pi * (1.0 + 0.44)), rel=0.01)


@pytest.mark.parametrize("masked", [0.006, 0.5, 150.0])
def test_after_a_step_the_first_reading_decides(masked):
    knots, values = [0.0, 1.0, 1.0 + 1e-6, 1000.0], [0.0, 0.0, 4e3, 4e3]
    read = np.concatenate([np.linspace(0.0, 1.0, 11), np.linspace(1.0 + masked, 999.0, 100)])
    found = fastest(experiment(knots, values, read))
    assert found == pytest.approx(1.0 / (2.0 * np.pi * masked), rel=1e-3)


def test_a_step_that_nothing_was_read_after_leaves_the_word_to_the_sine():
    time = np.linspace(0.0, 1.0, 10001)
    values = np.where(time < 0.05, 0.0, 1000.0 + 1000.0 * np.sin(20.0 * np.pi * (time - 0.05)))
    whole = fastest(experiment(time, values, time))
    cropped = fastest(experiment(time, values, time[time > 0.2]))
    assert whole > 100.0
    assert cropped == pytest.approx(10.0, rel=0.1)


def test_a_voltage_is_zero_before_it_begins():
    """As every system takes it: a constant voltage is a step, a constant stretch is none."""
    held = experiment([0.0, 1.0], [5.0, 5.0], [0.0, 0.001, 0.5])
    assert fastest(held) == 0.0
    driven = replace(held, excitation=replace(held.excitation, name="voltage", unit="V"))
    assert fastest(driven) == pytest.approx(1.0 / (2.0 * np.pi * 0.001), rel=1e-3)


def test_nothing_changes_or_nothing_was_read_afterwards():
    assert fastest(experiment([0.0, 1.0], [0.0, 0.0], [0.5])) == 0.0
    assert fastest(experiment([0.0, 1.0, 1.1, 2.0], [0.0, 0.0, 1.0, 1.0], [0.2, 0.4])) == 0.0


def test_no_frequency_without_time():
    assert np.isnan(fastest(experiment([1.0, 2.0], [1.0, 2.0], [1.0, 2.0], "stretch")))


def test_it_does_not_depend_on_the_units_of_time_and_voltage():
    rng = np.random.default_rng(7)
    for _ in range(40):
        knots = np.cumsum(10.0 ** rng.uniform(-6.0, 2.0, 12))
        values, read = rng.normal(size=12), np.sort(rng.uniform(knots[0], knots[-1], 20))
        found = fastest(experiment(knots, values, read))
        scaled = fastest(experiment(1e-3 * knots, 1e3 * values + 7.0, 1e-3 * read))
        assert np.isfinite(found)
        assert scaled == pytest.approx(1e3 * found, rel=1e-3)
