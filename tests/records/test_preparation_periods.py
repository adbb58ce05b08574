"""Periods and whole cycles of an excitation, and what the step `cycles` refuses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.shared.periodic_records import Signal, biased, record, reduced, said, unbiased

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.records.columns import RawRecord


@pytest.mark.parametrize("frequency", [1.0, 2.0, 3.0, 6.0, 7.0, 9.0, 10.0])
@pytest.mark.parametrize("volts", [biased, unbiased])
@pytest.mark.parametrize("rest", [0.0, 0.7013])
def test_the_period_is_found(frequency: float, volts: Callable, rest: float) -> None:
    experiment = reduced(record(frequency, volts=volts(frequency), rest=rest), stated=frequency)
    entry = said(experiment)
    assert entry["period_s"] == pytest.approx(1.0 / frequency, rel=1e-5)
    assert entry["cycles"] == 50
    assert entry["group_sizes"] == [1] * 5 + [9] * 5
    assert experiment.coordinate.size == 400
    first = entry["first_cycle_s"]
    assert rest - 0.05 / frequency - 2e-3 <= first <= rest + 1e-3


def test_a_first_pass_that_comes_late_is_not_heard() -> None:
    """An amplifier at its current limit takes 4 % of the first period more to rise."""

    def volts(time: FloatArray) -> FloatArray:
        return biased(2.0)(np.where(time < 0.35, time - 0.02, time))

    for count in (8, 20, 50):
        entry = said(reduced(record(2.0, count=count, volts=volts)))
        assert entry["period_s"] == pytest.approx(0.5, rel=1e-4 if count > 8 else 1e-3)


@pytest.mark.parametrize("rest", [0.0, 2.0])
def test_a_monitor_noise_of_one_per_cent_does_no_harm(rest: float) -> None:
    for seed in range(10):
        entry = said(reduced(record(7.0, rest=rest, monitor=50.0, seed=seed)))
        assert entry["period_s"] == pytest.approx(1.0 / 7.0, rel=3e-4)
        assert 49 <= entry["cycles"] <= 50


@pytest.mark.parametrize("knots", [{"tolerance": "5 V"}, {"tolerance": "2 V"}])
def test_cycles_are_found_on_a_thinned_excitation(knots: object) -> None:
    entry = said(reduced(record(3.0, rest=0.5), {"excitation_knots": knots}))
    assert entry["period_s"] == pytest.approx(1.0 / 3.0, rel=1e-5)
    assert entry["cycles"] == 50


def chirp(rate: float) -> Signal:
    return lambda time: 2500.0 * np.sin(2.0 * np.pi * (2.0 * time + 0.5 * rate * time**2))


def double(time: FloatArray) -> FloatArray:
    """Passes its middle twice per second in either direction, half a second apart."""
    phase = time % 1.0
    hump = np.where(phase < 0.7, np.sin(np.pi * phase / 0.35), np.sin(np.pi * (phase - 0.7) / 0.15))
    return 1000.0 * hump


def uneven(time: FloatArray) -> FloatArray:
    """Passes its middle twice per second, 0.3 and 0.7 s apart."""
    phase = time % 1.0
    return 1000.0 * np.where((phase < 0.2) | ((phase > 0.3) & (phase < 0.5)), 1.0, -1.0)


@pytest.mark.parametrize(
    ("raw", "settings", "message"),
    [
        (record(2.0, volts=lambda t: np.where(t > 1.0, 3000.0, 0.0)), {},
         "passes the middle of its range 1 times, so it does not have 3 cycles; use `average`"),
        (record(2.0, count=2.0), {}, "does not have 3 cycles"),
        (record(2.0, count=3.4), {"frequency": "1.9 Hz", "transition": 3, "window": 1.0}, None),
        (record(2.0, count=4), {"frequency": "1.2 Hz"}, "2 whole cycles of 0.833333 s are visible"),
        (record(2.0, volts=chirp(0.2)), {}, "is not periodic, it passes the middle of its range"),
        (record(2.0, volts=chirp(0.001)), {}, "use `average` for a sweep, a step or a few cycles"),
        (record(1.0, volts=double), {}, "or give the right `frequency`"),
        (record(1.0, volts=uneven), {}, "s; use `average` for a sweep, a step or a few cycles, or "
         "give `frequency`"),
        (record(1.0, volts=uneven), {"frequency": "1 Hz"}, None),
        (record(1.0, volts=double), {"frequency": "1 Hz"}, None),
        (record(2.0), {"frequency": "2.01 Hz"}, "does not repeat itself every 0.497512 s: cycle 6"),
        (record(2.0), {"stated": 1.9}, "voltage has 2 Hz, experiments.csv says frequency_Hz 1.9"),
        (record(2.0), {"stated": 2.0, "frequency": "1 Hz"}, "has 1 Hz, experiments.csv says"),
        (record(2.0), {"stated": "two"}, None),
        (record(2.0), {"group": 8}, "half a period off their phase; give an odd number, such as 9"),
        (record(2.0), {"group": 47}, "47 cycles, but only 45 follow the transition"),
        (record(10.0), {"points": 80}, "a cycle has 100 samples, too few for 80 points that each "
         "average 0.5 of a bin; give `points: 50` or fewer"),
        (record(2.0), {"points": 4}, "expected a whole number >= 8, found 4"),
        (record(2.0), {"transition": -1}, "expected a whole number >= 0, found -1"),
        (record(2.0), {"window": 1.5}, "must lie between 0.01 and 1"),
        (record(2.0), {"stable": "averag"}, "did you mean 'average'"),
        (record(2.0), {"frequency": "2 s"}, "cycles.frequency"),
        (record(2.0), {"cycle": 2}, "unknown setting 'cycle'"),
    ],
)  # fmt: skip
def test_mistakes_are_named(raw: RawRecord, settings: dict, message: str | None) -> None:
    if message is None:
        assert reduced(raw, **settings).coordinate.size >= 100
        return
    with pytest.raises(UserError) as error:
        reduced(raw, **settings)
    assert message in str(error.value)
    assert str(error.value).startswith("preparation of a (sine), cycles")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("share", "about", "message"),
    [
        (0.8, 2750.0, "cycle 31, from 15 s, differs from the others by"),
        (
            0.6,
            0.0,
            "repeats itself every 0.5 s only until 15 s and goes on otherwise; put `crop: {to: 15",
        ),
    ],
)
def test_another_amplitude_half_way_is_no_end(share: float, about: float, message: str) -> None:
    raw = record(2.0)
    volts = about + np.where(raw.columns["time"] > 15.0, share, 1.0) * (
        raw.columns["voltage"] - about
    )
    changed = RawRecord(raw.columns | {"voltage": volts}, raw.units, raw.sha256)
    with pytest.raises(UserError) as error:
        reduced(changed)
    assert message in str(error.value)
    assert said(reduced(changed, {"crop": {"to": "15 s"}}))["cycles"] == 30


def test_a_first_ramp_to_the_bias_is_no_fault() -> None:
    def volts(time: FloatArray) -> FloatArray:
        sine = 2250.0 * np.sin(4.0 * np.pi * (time - 1.1)) + 2750.0
        return np.where(time < 1.1, np.minimum(2750.0, 5000.0 * time), sine)

    entry = said(reduced(record(2.0, volts=volts, rest=0.3)))
    assert entry["period_s"] == pytest.approx(0.5, rel=1e-5)
    assert 0.3 < entry["first_cycle_s"] < 1.4  # the sine begins at 1.4 s


def test_a_first_jump_through_the_middle_is_no_cycle() -> None:
    """4 kV for a second, then four cycles: the gap before them does not count."""

    def volts(time: FloatArray) -> FloatArray:
        return np.where(time < 1.1, 4000.0, 2250.0 * np.sin(4.0 * np.pi * (time - 1.1)) + 2750.0)

    entry = said(reduced(record(2.0, volts=volts, rest=0.3, count=6.2)))
    assert entry["period_s"] == pytest.approx(0.5, rel=1e-4)


def test_excitation_at_rest_without_the_sine_is_refused() -> None:
    with pytest.raises(UserError, match=r"0 whole cycles of 0\.5 s are visible"):
        reduced(record(2.0, after=30.0), {"crop": {"from": "40 s"}})


def test_a_sine_that_goes_on_behind_a_mask_is_no_fault() -> None:
    masked = {"mask_after": {"time": "20.2 s"}}
    assert said(reduced(record(2.0), masked))["cycles"] == 40


def test_remarks_are_of_one_step() -> None:
    """What `cycles` says of itself is not said again of the step after it."""
    first = reduced(record(2.0))
    again = reduced(record(2.0), {"mask_after": {"time": "20 s"}}, then="excitation_knots")
    assert "cycles of" in str(first.steps[-1]["effect"])
    assert set(again.steps[-1]) == {"step", "settings", "effect", "masked"}
    assert "cycles of" not in str(again.steps[-1]["effect"])
