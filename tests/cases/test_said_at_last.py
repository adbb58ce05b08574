"""What was passed over is said: of folders, of records, and of models that do not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from deabayes.checks.folder import check_folder
from deabayes.prediction.errors import rejected
from tests.cases.study_folder import made, noisy, row
from tests.cases.test_fast_and_slow import TUBE, creep, displacement


def test_a_folder_is_checked_as_strongly_as_a_study(tmp_path: Path) -> None:
    """A voltage in kV declared as V makes the tube a million times too soft."""
    time = np.arange(0.0, 0.5, 1e-3)
    voltage = np.where(time >= 0.02, 2000.0, 0.0)
    columns = {
        "time [s]": time,
        "voltage [V]": voltage / 1e3,
        "displacement [m]": noisy(displacement(time, voltage, 0.05), 1e-7),
    }
    rows = [row("creep", "creep", "voltage", "displacement")]
    study = made(tmp_path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])
    report = check_folder(study.path / "specimen")
    (said,) = [line for line in report.warnings if "are the units of record" in line]
    assert said.startswith("voigt_kelvin_1, creep: displacement reaches")


def test_a_sound_folder_has_no_fault(tmp_path: Path) -> None:
    study = creep(tmp_path, 0.05, 0.02, 0.52, 1e-3, 1e-7)
    assert check_folder(study.path / "specimen").faults == []


def driven(path: Path, voltage: np.ndarray, time: np.ndarray):
    columns = {
        "time [s]": time,
        "voltage [V]": voltage,
        "displacement [m]": noisy(displacement(time, voltage, 0.05), 1e-7),
    }
    rows = [row("creep", "creep", "voltage", "displacement")]
    return made(path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])


def test_a_sine_called_creep_is_a_fault_and_pulses_are_none(tmp_path: Path) -> None:
    time = np.arange(0.0, 1.0, 1e-3)
    swings = 1000.0 * (1.0 - np.cos(20.0 * np.pi * time))
    (fault,) = driven(tmp_path / "sine", swings, time).faults
    assert "is called a creep, but its voltage swings 10 times at even distances" in fault
    pulses = np.where((time * 10.0) % 1.0 < 0.5, 0.0, 2000.0)
    assert not driven(tmp_path / "pulses", pulses, time).faults


def test_a_sensor_at_its_limit_for_most_of_the_record_is_a_fault(tmp_path: Path) -> None:
    study = creep(tmp_path, 0.05, 0.02, 0.52, 1e-3, 1e-7)
    specimen = study.path / "specimen" / "specimen.yaml"
    sensor = "instruments: {displacement: {range: {value: 0.13, unit: mm}}}\n"
    specimen.write_text(specimen.read_text() + sensor)
    path = study.path / "specimen" / "records" / "creep.csv"
    table = pd.read_csv(path)
    table["displacement [m]"] = np.minimum(table["displacement [m]"], 0.13e-3)
    table.to_csv(path, index=False)
    assert any("of the values lie at the sensor's range of 130 µm" in f for f in study.faults)


def test_what_rejects_a_model_it_was_fitted_to() -> None:
    errors = pd.DataFrame({
        "experiment": ["a", "b", "c", "d"],
        "role": ["calibrate", "calibrate", "calibrate", "validate"],
        "coverage_90": [0.9, 0.3, 0.92, 0.1],
        "pit_p": [0.4, 0.2, 1e-5, 1e-9],
    })  # fmt: skip
    assert list(rejected(errors)["experiment"]) == ["b", "c"]


def test_a_channel_that_a_slower_clock_reads_is_named(tmp_path: Path) -> None:
    """A logger that writes the slow channel's last value beside the fast one's (smuview#58)."""
    study = creep(tmp_path, 0.05, 0.02, 0.52, 1e-3, 1e-7)
    assert not [line for line in study.warnings if "values lag" in line]
    path = study.path / "specimen" / "records" / "creep.csv"
    table = pd.read_csv(path)
    values = table["displacement [m]"].to_numpy()
    table["displacement [m]"] = values[np.arange(values.size) // 20 * 20]
    table.to_csv(path, index=False)
    (said,) = [line for line in study.warnings if "values lag" in line]
    assert "changes every 20 samples only" in said and "`decimate: {every: 20}`" in said
