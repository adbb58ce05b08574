"""Noise in proportion to a response's range, where little of the response was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.prediction.test_noise_origin import TIME, fitted, record
from tests.shared.membranes import step

from deabayes.experiment import Experiment


def asked(time, volts, response="displacement"):
    unit = {"displacement": "m", "area": "m^2"}[response]
    return Experiment(
        "prediction", "prediction", "validate", "time", "s", time, response, unit,
        np.full(time.size, np.nan), np.ones(time.size), step(volts),
    )  # fmt: skip


def at_the_end(found, what):
    samples = found.sample(what, np.random.default_rng(1))
    return np.std(samples.predictive[:, -1] - samples.parameter[:, -1]), samples.noise_note


def test_the_band_at_a_time_does_not_depend_on_other_times():
    found = fitted(noise_scale="range")
    whole, note = at_the_end(found, asked(TIME, 4e3))
    assert note == ""
    assert whole == pytest.approx(30e-6 * record(4e3).response_range, rel=0.15)
    for few in (TIME[-30:], TIME[-1:]):
        part, note = at_the_end(found, asked(few, 4e3))
        assert part == pytest.approx(whole, rel=0.15)
        assert note == (
            "the response varies by less than in any calibrated record of step, so its noise is "
            "in proportion to the smallest range of these records "
            f"({record(4e3).response_range:.3g} m)"
        )


def test_at_rest_a_reading_is_as_noisy_as_in_the_smallest_record():
    found = fitted([record(4e3), record(2e3)], noise_scale="range")
    size, note = at_the_end(found, asked(TIME, 0.0))
    assert size == pytest.approx(30e-6 * record(2e3).response_range, rel=0.15)
    assert "smallest range" in note
    larger, note = at_the_end(found, asked(TIME, 3e3))
    assert larger == pytest.approx(30e-6 * record(3e3).response_range, rel=0.15)
    assert note == ""


@pytest.mark.parametrize("noise_scale", ["absolute", "range", "mixed"])
@pytest.mark.parametrize("what", [asked(TIME, 0.0, "area"), asked(TIME[:1], 2e3, "area")])
def test_noise_carried_over_to_a_response_that_does_not_vary_is_not_known(what, noise_scale):
    samples = fitted(noise_scale=noise_scale).sample(what, np.random.default_rng(1))
    assert np.isfinite(samples.parameter).all()
    assert np.isnan(samples.discrepancy).all() and np.isnan(samples.predictive).all()
    assert samples.noise_note.endswith("size is not known")


def test_one_point_of_another_coordinate_has_noise():
    """Of a single point no correlation length matters."""
    one = replace(asked(TIME[:1], 2e3), coordinate_name="voltage", response=np.array([np.nan]))
    assert fitted().noise_of(one).stretch == 1.0
