"""Amplitudes read along a sweep."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared import structure_contexts as made_up

from deabayes.papers import timing
from deabayes.papers.timing import Sweep


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
