"""Slips, breaks, lost readings and dropouts: what jumps though the other channel does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes import simulate
from deabayes.experiment import FloatArray
from deabayes.records.channels import dropouts, response_jumps
from tests.cases.study_folder import made, noisy, row
from tests.cases.test_fast_and_slow import TUBE, displacement

TIME = np.arange(0.0, 0.52, 1e-3)
VOLTAGE = np.where(TIME >= 0.02, 2000.0, 0.0)
MOVED = noisy(displacement(TIME, VOLTAGE, 0.05), 3e-7)


def said(path: Path, voltage: FloatArray, moved: FloatArray) -> list[str]:
    """Warnings of a tube's creep that a jump is the reason of."""
    columns = {"time [s]": TIME, "voltage [V]": voltage, "displacement [m]": moved}
    rows = [row("creep", "creep", "voltage", "displacement")]
    study = made(path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])
    assert not study.faults
    return [line for line in study.warnings if ": jumps by" in line]


def test_a_clean_creep_has_none(tmp_path: Path) -> None:
    assert not said(tmp_path, VOLTAGE, MOVED)


@pytest.mark.parametrize("step", [6.25e-6, 17e-6])
def test_steps_of_a_coarse_display_are_none(tmp_path: Path, step: float) -> None:
    assert not said(tmp_path, VOLTAGE, np.round(MOVED / step) * step)


@pytest.mark.parametrize("slip", [6e-6, -2e-5])
def test_a_sensor_that_slips_is_named(tmp_path: Path, slip: float) -> None:
    (line,) = said(tmp_path, VOLTAGE, MOVED + slip * (TIME >= 0.25))
    assert "column displacement" in line and "at 0.25 s, though the voltage does not" in line
    assert "keep what is before it (`crop`)" in line


def test_readings_that_are_lost_for_a_while_are_named(tmp_path: Path) -> None:
    lost = (TIME >= 0.1) & (TIME < 0.11)
    (line,) = said(tmp_path, VOLTAGE, np.where(lost, 0.0, MOVED))
    assert "at 0.1 s (and 1 more)" in line


def test_a_number_that_was_cut_off_at_the_end_is_named(tmp_path: Path) -> None:
    (line,) = said(tmp_path, VOLTAGE, np.where(TIME[-1] == TIME, 1e-4, MOVED))
    assert "at 0.519 s" in line


def test_a_monitor_that_drops_out_is_named(tmp_path: Path) -> None:
    (line,) = said(tmp_path, np.where((TIME > 0.2595) & (TIME < 0.2625), 0.0, VOLTAGE), MOVED)
    assert "column voltage: jumps by -2 kV at 0.26 s, soon jumps back" in line


def pull() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, displacement and force of a strip that relaxes much at the turn of its pull."""
    time = np.arange(0.0, 40.0, 0.05)
    driven = 0.03 * np.clip(1.0 - np.abs(time - 20.0) / 19.0, 0.0, 1.0)
    truth = {"mu": 40e3, "mu_beta_1": 300e3, "tau_1": 0.3}
    strip = {"cross_section": 1e-5, "gauge_length": 0.05}
    found = simulate(
        "tensile_strip", "neo_hookean_units_1", truth, strip, time=time, displacement=driven,
        response="force",
    )  # fmt: skip
    return time, driven, noisy(found["force"].values, 1e-3)


def test_the_turn_of_a_pull_is_no_jump_and_a_break_is() -> None:
    time, driven, force = pull()
    size = float(np.ptp(driven))
    assert response_jumps(driven, size, force).size == 0
    broken = np.where(time < 15.0, force, 0.0)
    assert list(time[response_jumps(driven, size, broken)]) == [pytest.approx(15.0)]


def test_pulses_that_a_response_follows_are_no_dropouts() -> None:
    voltage = np.where((TIME > 0.2595) & (TIME < 0.2625), 0.0, VOLTAGE)
    assert dropouts(voltage, MOVED).size == 1
    assert dropouts(voltage, displacement(TIME, voltage, 0.05)).size == 0
