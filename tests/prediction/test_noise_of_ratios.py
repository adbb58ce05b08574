"""Noise of gains and phases, which are ratios and angles, carried over to other responses."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deabayes.experiment import Excitation, Experiment
from deabayes.prediction.calibrated import CalibratedRecord
from deabayes.prediction.noise_origin import find_noise

SYSTEM = SimpleNamespace(
    proportional=("gain",),
    responses={"strain": "1", "gain": "1/V", "phase": "rad", "current": "A"},
    candidate="voigt_kelvin_2",
    specimen=SimpleNamespace(instruments={}),
)
GAIN = CalibratedRecord(
    "shaken", "frequency_response", "gains", 1.0, "gain", "frequency", 190.0, "frequency",
    10.0, 200.0, 8e-7, proportional=True,
)  # fmt: skip
PHASE = replace(
    GAIN, name="shaken_phase", response_name="phase", response_range=2.9, proportional=False
)
CREEP = replace(
    GAIN, name="creep", protocol="creep", group="creep", response_name="strain",
    response_range=0.04, proportional=False,
)  # fmt: skip
RANGE = 0.02


def strain() -> Experiment:
    time = np.linspace(0.0, 1.0, 50)
    drive = Excitation("voltage", "V", time, np.full(50, 2000.0))
    return Experiment(
        "pulled", "creep", "validate", "time", "s", time, "strain", "1", np.full(50, np.nan),
        np.ones(50), drive,
    )  # fmt: skip


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("records", [[GAIN], [PHASE], [GAIN, PHASE]])
def test_a_hundredth_of_a_gain_is_a_hundredth_of_a_strains_range(records, relative):
    """Whatever unit the gain is in: its residuals are logarithms, those of a phase radians."""
    origin = find_noise(strain(), records, SYSTEM, relative, "record")
    mean = np.linspace(0.0, RANGE, 50)[None]
    assert origin.scales(mean) == pytest.approx([RANGE])


def test_noise_in_a_unit_is_a_share_of_its_own_range():
    current = replace(strain(), response_name="current", response_unit="A")
    origin = find_noise(current, [CREEP], SYSTEM, False, "record")
    mean = np.linspace(0.0, RANGE, 50)[None]
    assert origin.scales(mean) == pytest.approx([RANGE / 0.04])
