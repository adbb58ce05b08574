"""Rows without a value or at a repeated time: refused, or left out where that is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes.faults import Faults, Report
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import read_folder
from deabayes.records.record import hidden_excitation

SPECIMEN = """\
name: strip
system: tensile_strip
provenance: {kind: measured, source: here, licence: none}
quantities: {}
"""
TABLE = """\
name,protocol,record,role,excitation,response
pull,relaxation,a.csv,calibrate,stretch,nominal_stress
"""


def folder(tmp_path: Path, lines: list[str], more: str = "") -> Path:
    time = np.arange(40) * 0.1
    rows = [f"{t:.1f},{1 + 0.1 * (k > 3) + 0.001 * k},{k % 7 + 5}" for k, t in enumerate(time)]
    rows[10:10] = lines
    text = "\n".join(
        ["time [s],stretch [1],nominal_stress [kPa],note [s]", *(f"{r}," for r in rows)]
    )
    (tmp_path / "a.csv").write_text(text + "\n", encoding="utf-8")
    (tmp_path / "specimen.yaml").write_text(SPECIMEN + more, encoding="utf-8")
    (tmp_path / "experiments.csv").write_text(TABLE, encoding="utf-8")
    return tmp_path


BAD = ["0.95,1.103,", "0.95,,7", "0.97,1.1,6", "0.97,1.2,6", "0.98,1.1,nan", "0.98,1.1,6"]
DROP = "record_format: {incomplete_rows: drop}\n"


@pytest.mark.parametrize(
    ("lines", "said"), [(BAD[:1], "values missing"), (BAD[2:4], "repeats the time")]
)
def test_they_are_refused_with_the_way_out(tmp_path: Path, lines: list[str], said: str) -> None:
    with pytest.raises(Faults, match=said) as caught:
        read_folder(folder(tmp_path, lines))
    assert "record_format: {incomplete_rows: drop}" in str(caught.value)


def test_they_are_left_out_and_counted(tmp_path: Path) -> None:
    """Of a time given twice the first complete row stays; a column not needed may have gaps."""
    read = read_folder(folder(tmp_path, BAD, DROP))
    (row,) = read.table
    raw = read.record(row)
    assert raw.left_out == 4
    inside = raw.columns["time"][9:13]
    np.testing.assert_allclose(inside, [0.9, 0.97, 0.98, 1.0])
    np.testing.assert_allclose(raw.columns["stretch"][10:12], [1.1, 1.1])
    (warning,) = [w for w in read.warnings(row) if "left out" in w]
    assert "4 of 46 data rows" in warning


def test_a_sound_record_stays_whole_without_a_word(tmp_path: Path) -> None:
    read = read_folder(folder(tmp_path, [], DROP))
    (row,) = read.table
    assert read.record(row).left_out == 0
    assert not any("left out" in warning for warning in read.warnings(row))


def test_time_that_goes_back_is_refused_all_the_same(tmp_path: Path) -> None:
    with pytest.raises(Faults, match="goes back"):
        read_folder(folder(tmp_path, ["0.2,1.1,6"], DROP))


@pytest.mark.parametrize("more", ["", DROP])
def test_a_column_without_any_value_is_named(tmp_path: Path, more: str) -> None:
    """Left out row by row, nothing of the record would stay and the file seem cut off."""
    table = TABLE.replace("nominal_stress\n", "force\n")
    path = folder(tmp_path, [], more) / "a.csv"
    text = path.read_text(encoding="utf-8").replace("note [s]", "force [N]")
    path.write_text(text, encoding="utf-8")
    (tmp_path / "experiments.csv").write_text(table, encoding="utf-8")
    with pytest.raises(
        Faults, match="column force: holds no value in any of its 40 rows"
    ) as caught:
        read_folder(tmp_path)
    assert "incomplete_rows" not in str(caught.value)


NEEDED = ("time", "voltage", "displacement")
TIME = 0.01 * np.arange(400)
STEP = np.where(TIME < 1.0, 0.0, 3000.0)
"""In data row 101."""
RAMP = np.interp(TIME, [1.0, 3.0], [0.0, 3000.0])
SINE = 1500.0 * (1.0 - np.cos(2.0 * np.pi * TIME))
"""A hundred samples in a cycle."""
FROM_THE_START = np.full(400, 3000.0)
LAST_DIGIT = FROM_THE_START + 5.0 * (np.random.default_rng(3).random(400) < 0.05)
"""A monitor whose last digit changes now and then."""


def hidden(
    voltage: np.ndarray, lost: slice, before: float | None = 0.0, repeated: slice = slice(0)
) -> list[str]:
    """What is said where the displacement is lost in some rows, and times are given twice."""
    displacement = np.arange(400.0)
    displacement[lost] = np.nan
    time = TIME.copy()
    time[repeated] -= 0.01
    row = ExperimentRow("step", "step", "a.csv", "calibrate", "voltage", "displacement")
    units = {"time": "s", "voltage": "V", "displacement": "m"}
    columns = {"time": time, "voltage": voltage, "displacement": displacement}
    raw = RawRecord(columns, units, "ab" * 32)
    report = Report("a.csv (step)")
    hidden_excitation(row, raw, NEEDED, before, report)
    return report.faults


@pytest.mark.parametrize(
    ("lost", "rows", "missed"),
    [
        (slice(90, 110), "data rows 91 to 110", "1.43 kV"),
        (slice(99, 100), "data row 100", "1.5 kV"),  # the jump is that to the next row
        (slice(100, 101), "data row 101", "1.5 kV"),
        (slice(0, 105), "data rows 1 to 105", "3 kV"),
    ],
)
def test_a_jump_among_rows_left_out_is_refused(lost: slice, rows: str, missed: str) -> None:
    """It was drawn out over them, or moved to the first row that stays."""
    (fault,) = hidden(STEP, lost)
    assert fault.startswith(f"a.csv (step), column voltage: {rows}, without displacement,")
    assert f"up to {missed} off" in fault and "`mask_between`" in fault


@pytest.mark.parametrize(
    ("voltage", "lost"),
    [
        (STEP, slice(110, 300)),
        (STEP, slice(0, 100)),  # rest, then a step at the first row that stays
        (STEP, slice(90, 400)),  # no response behind it
        (RAMP, slice(120, 280)),
        (SINE, slice(130, 132)),
        (FROM_THE_START, slice(50, 150)),
        (LAST_DIGIT, slice(50, 150)),
    ],
)
def test_rows_that_hide_nothing_of_the_excitation_may_go(voltage: np.ndarray, lost: slice) -> None:
    assert hidden(voltage, lost) == []


def test_a_curve_is_off_its_chord_by_what_is_left_out_of_it() -> None:
    """By (1 - cos(2 pi 3/100))/2 of its range where five rows go, 0.9 %; more with six."""
    assert hidden(SINE, slice(148, 153)) == []
    (fault,) = hidden(SINE, slice(147, 153))
    assert "data rows 148 to 153" in fault and "up to 35.4 V off" in fault


def test_a_monitors_noise_is_nothing_that_is_hidden() -> None:
    noise = np.random.default_rng(7).normal(0.0, 20.0, 400)
    assert hidden(RAMP + noise, slice(120, 280)) == []
    assert len(hidden(STEP + noise, slice(90, 110))) == 1


def test_random_levels_are_no_noise() -> None:
    levels = np.random.default_rng(8).uniform(0.0, 3000.0, 400)
    assert len(hidden(levels, slice(120, 124))) == 1


def test_what_came_before_the_first_complete_row_depends_on_the_system() -> None:
    assert "3 kV off" in hidden(FROM_THE_START, slice(20))[0]
    assert hidden(FROM_THE_START, slice(20), before=None) == []


def test_rows_at_a_repeated_time_hide_nothing() -> None:
    assert hidden(STEP, slice(0), repeated=slice(100, 101)) == []


def test_the_folder_refuses_such_a_record(tmp_path: Path) -> None:
    """The stretch is 1.1 from 0.4 s on; of a strip, what it was at first was held before."""
    path = folder(tmp_path, [], DROP) / "a.csv"
    text = path.read_text(encoding="utf-8")
    for at, stress in (("0.3", 8), ("0.4", 9)):
        (line,) = [each for each in text.splitlines() if each.startswith(f"{at},")]
        text = text.replace(line, line.replace(f",{stress},", ",,"))
    path.write_text(text, encoding="utf-8")
    with pytest.raises(Faults, match=r"a\.csv \(pull\), column stretch: data rows 4 to 5, without"):
        read_folder(tmp_path)
