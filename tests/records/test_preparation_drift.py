"""Drift within the groups of `cycles`: how far it moves their means, and when it is said."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.periodic_records import record, reduced, said, warned

from deabayes.records.columns import RawRecord


def settling(tau: float) -> RawRecord:
    raw = record(2.0, noise=0.01)
    time = raw.columns["time"]
    slow = 2.0 * (1.0 - np.exp(-time / tau))
    return RawRecord(raw.columns | {"displacement": raw.columns["displacement"] + slow},
                     raw.units, raw.sha256)  # fmt: skip


def test_a_transition_that_is_not_over_is_a_warning() -> None:
    experiment = reduced(settling(5.0))
    # the first group's cycle means: from the middles of cycles 6 and 14, 2.75 s and 6.75 s
    slow = 2.0 * np.exp(-np.arange(2.75, 7.0, 0.5) / 5.0)
    entry = said(experiment)
    assert entry["drift"] == pytest.approx(np.ptp(slow) / np.ptp(experiment.response), rel=0.05)
    off = slow.mean() - slow[4]
    assert entry["off_middle"] == pytest.approx(off / np.ptp(experiment.response), rel=0.1)
    (warning,) = warned(experiment)
    assert "still settles after 5 cycles; raise `transition`" in warning
    assert f"up to {entry['off_middle']:.2%} of the range off" in warning
    assert not warned(reduced(settling(5.0), stable="decimate"))
    assert not warned(reduced(settling(0.5)))


def test_what_cancels_is_no_warning() -> None:
    """A steady drift, of 40 % of the range in a group."""
    experiment = reduced(record(2.0, drift=0.2, noise=0.01))
    assert said(experiment)["drift"] == pytest.approx(0.8 / np.ptp(experiment.response), rel=0.02)
    assert said(experiment)["off_middle"] < 1e-3
    assert not warned(experiment)


@pytest.mark.parametrize("group", [3, 5, 9])
def test_how_far_means_are_off(group: int) -> None:
    """Exact where the response bends as a parabola: c (G^2 - 1) / 12 per cycle squared."""
    raw = record(2.0)
    bent = raw.columns["displacement"] + 1e-3 * raw.columns["time"] ** 2
    experiment = reduced(RawRecord(raw.columns | {"displacement": bent}, raw.units, raw.sha256),
                         group=group)  # fmt: skip
    off = 1e-3 * 0.5**2 * (group**2 - 1) / 12
    assert said(experiment)["off_middle"] * np.ptp(experiment.response) == pytest.approx(
        off, rel=0.1
    )


def test_a_growing_amplitude_is_drift_too() -> None:
    raw = record(2.0)
    time = raw.columns["time"]
    grown = raw.columns["displacement"] * (1.0 + 0.01 * time)
    experiment = reduced(RawRecord(raw.columns | {"displacement": grown}, raw.units, raw.sha256))
    assert said(experiment)["drift"] == pytest.approx(0.04 / np.ptp(grown), rel=0.15)


def test_noise_is_no_drift() -> None:
    for seed in range(5):
        experiment = reduced(record(10.0, noise=0.1, seed=seed))
        assert said(experiment)["drift"] == said(experiment)["off_middle"] == 0.0
        assert not warned(experiment)
