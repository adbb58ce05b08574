"""Rows without a value or at a repeated time: refused, or left out where that is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes.faults import Faults
from deabayes.reading.folder import read_folder

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


BAD = ["0.95,1.1,", "0.95,,7", "0.97,1.1,6", "0.97,1.2,6", "0.98,1.1,nan", "0.98,1.1,6"]
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
