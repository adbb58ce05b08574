"""LabVIEW measurement files: units, decimal sign and sampling come from their head."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.step_record import TIME, VOLTAGE_KV, check

from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record

HEAD = """\
LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tNo
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t3\t3\t
Y_Unit_Label\tkV\tmm\t
X_Dimension\tTime\tTime\t
X0\t0.0\t0.0\t
Delta_X\t0.5\t0.5\t
***End_of_Header***\t\t\t
X_Value\tVoltage\tLaser\tComment
"""


def rows(first: list[str], comment: str = "") -> str:
    """Data rows, the second of which has a comment."""
    cells = zip(first, VOLTAGE_KV, TIME, ["", comment, ""], strict=True)
    return "".join(f"{x}\t{u:.4f}\t{t:.4f}{'' if not c else chr(9) + c}\n" for x, u, t, c in cells)


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8", newline="\r\n")
    return path


@pytest.mark.parametrize("comment", ["", "door slammed"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("separator", ["\t", ";"])
def test_time_from_the_head(tmp_path: Path, comment: str, decimal: str, separator: str) -> None:
    text = HEAD + rows(["", "", ""], comment)
    text = text.replace(".", decimal).replace("\t", separator)
    record = read_record(written(tmp_path / "a.lvm", text))
    check(record)
    assert record.notes[0] == "time from X0 and Delta_X: every 0.5 s, from 0 s"


def test_a_time_column_and_other_names(tmp_path: Path) -> None:
    text = HEAD.replace("X_Columns\tNo", "X_Columns\tOne") + rows([f"{t}" for t in TIME])
    path = written(tmp_path / "a.txt", text)
    check(read_record(path))
    named = from_text("X_Value = time [s]; Laser = displacement [mm]")
    check(read_record(path, columns=named))
    np.testing.assert_allclose(read_record(path, columns=named).columns["displacement"], TIME / 1e3)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "Delta_X\t0.5\t0.5",
            "Delta_X\t0.5\t0.25",
            "no common X0 and Delta_X; save it with a time",
        ),
        ("Delta_X", "Delta", "no common X0 and Delta_X"),
        ("X_Columns\tNo", "X_Columns\tMulti", "a time for each channel"),
        ("X_Value\t", "Value\t", "has no row of names"),
        ("Samples", "***End_of_Header***\t\nSamples", "several measurements; save each as a file"),
        ("Y_Unit_Label\tkV", "Y_Unit_Label\tVolts", "column voltage: unknown unit 'Volts'"),
    ],
)
def test_what_a_head_may_lack(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = written(tmp_path / "a.lvm", HEAD.replace(old, new) + rows(["", "", ""]))
    with pytest.raises(UserError, match=said):
        read_record(path)


def test_a_head_without_rows(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no data rows after its head"):
        read_record(written(tmp_path / "a.lvm", HEAD))


def test_a_table_below_the_same_first_line(tmp_path: Path) -> None:
    lines = [f"{t};{u}\n" for t, u in zip(TIME, VOLTAGE_KV, strict=True)]
    text = "LabVIEW Measurement\nOperator;X\n\nTime (s);Voltage (kV)\n" + "".join(lines)
    check(read_record(written(tmp_path / "a.csv", text)))
