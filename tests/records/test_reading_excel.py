"""Excel records give what the same csv gives."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.shared.step_record import TIME, VOLTAGE_KV, check

from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record


def write_xlsx(path: Path, rows: list[list[object]]) -> Path:
    from openpyxl import Workbook

    workbook = Workbook()
    for row in rows:
        workbook.active.append(row)
    workbook.create_sheet("other").append(["nothing"])
    workbook.save(path)
    return path


def test_excel_first_sheet(tmp_path: Path) -> None:
    rows = [["time [s]", "voltage [kV]", "remark"], *zip(TIME, VOLTAGE_KV, "abc", strict=True)]
    record = read_record(write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows]))
    check(record)
    assert "remark" not in record.columns


def test_excel_rows_above_the_header_and_names_in_the_table(tmp_path: Path) -> None:
    rows = [["rig 7"], ["Zeit", "voltage [V]"], *zip(TIME, VOLTAGE_KV, strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    named = from_text("Zeit = time [s]; voltage [kV]")
    check(read_record(path, {"header_lines": 1}, columns=named))


def test_excel_without_a_header(tmp_path: Path) -> None:
    rows = [["t", "U", "", "note"], *zip(TIME, VOLTAGE_KV, "abc", strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    columns = [{"name": "time", "unit": "s"}, {"name": "voltage", "unit": "kV"}, {"name": "-"}]
    check(read_record(path, {"header_lines": 1, "columns": columns}))


@pytest.mark.parametrize(
    ("header_lines", "names", "words"),
    [
        (
            3,
            "time voltage force",
            "header_lines: 3 under record_format in specimen.yaml leaves out '0, 0, 0, ', which is "
            "data; state header_lines: 1",
        ),
        (1, "time voltage", "2 columns are named, but the first sheet has 3; name all of them"),
    ],
)
def test_excel_described_as_it_is_not(
    tmp_path: Path, header_lines: int, names: str, words: str
) -> None:
    rows = [["t", "U", "F", "note"], *zip(TIME, VOLTAGE_KV, "011", strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    units = {"time": "s", "voltage": "kV", "force": "N"}
    columns = [{"name": name, "unit": units[name]} for name in names.split()]
    with pytest.raises(UserError, match=rf"a\.xlsx: {words}"):
        read_record(path, {"header_lines": header_lines, "columns": columns})


def test_excel_line_breaks_within_the_cells_of_a_header(tmp_path: Path) -> None:
    rows = [["time\n[s]", "Hoch\r\nspannung [V]"], *zip(TIME, VOLTAGE_KV, strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    check(read_record(path, columns=from_text("Hoch spannung = voltage\n[kV]")))


def test_excel_text_among_numbers_is_named(tmp_path: Path) -> None:
    path = write_xlsx(tmp_path / "a.xlsx", [["time [s]", "force [N]"], [0, 1], [1, "n/a"]])
    with pytest.raises(UserError, match=r"a\.xlsx, column force, data row 2: 'n/a'"):
        read_record(path)


@pytest.mark.parametrize(
    "start",
    [datetime(2024, 5, 13, 10), datetime(2024, 5, 13, 10).time(), timedelta(days=1, seconds=5)],
)
def test_excel_dates_and_times(tmp_path: Path, start: object) -> None:
    path = write_xlsx(tmp_path / "a.xlsx", [["time [s]", "force [N]"], [start, 1], [start, 2]])
    with pytest.raises(UserError, match=r"data row 1: .* is a date .*; give seconds since the f"):
        read_record(path)


def test_excel_error_at_the_start_of_a_row_is_no_comment(tmp_path: Path) -> None:
    rows: list[list[object]] = [["time [s]", "force [N]"], ["# wait"], [0, 1], ["#N/A", 2], [2, 3]]
    path = write_xlsx(tmp_path / "a.xlsx", rows)
    with pytest.raises(UserError, match=r"column time, data row 2: '#N/A' is not a number"):
        read_record(path)


@pytest.mark.parametrize(
    "header", [[["Time (s)", "Force (N)"]], [["Time", "Force"], ["s", "N"]]], ids=["cells", "row"]
)
def test_excel_titles_above_and_units_in_or_below_the_header(
    tmp_path: Path, header: list[list[object]]
) -> None:
    rows: list[list[object]] = [["Run 7"], ["rate", 5], *header, [0, 1], [1, 3]]
    record = read_record(write_xlsx(tmp_path / "a.xlsx", rows))
    np.testing.assert_allclose(record.columns["force"], [1.0, 3.0])
    assert record.notes[0].startswith("header 'Time")
    assert record.notes[0].endswith("; what is above it is left out")


def rewritten(path: Path, change: Callable[[bytes], bytes]) -> Path:
    """An Excel file with its first sheet's XML changed."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    sheet = "xl/worksheets/sheet1.xml"
    parts[sheet] = change(parts[sheet])
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def test_excel_rows_of_unlike_length(tmp_path: Path) -> None:
    rows: list[list[object]] = [["time [s]", "force [N]"], [0, 1], [1, 2], ["end"]]
    path = write_xlsx(tmp_path / "a.xlsx", rows)
    rewritten(path, lambda xml: re.sub(rb"<dimension[^>]*/>", b"", xml))
    with pytest.raises(UserError, match=r"column time, data row 3: 'end' is not a number"):
        read_record(path)


@pytest.mark.parametrize("stated", [b"A1", b"A1:B3"])
def test_excel_sheet_larger_than_it_says(tmp_path: Path, stated: bytes) -> None:
    rows = [["time [s]", "voltage [kV]", "remark"], *zip(TIME, VOLTAGE_KV, "abc", strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    rewritten(
        path, lambda xml: re.sub(rb'<dimension ref="[^"]*"', b'<dimension ref="%s"' % stated, xml)
    )
    check(read_record(path))


def test_excel_formulas_without_stored_values(tmp_path: Path) -> None:
    rows: list[list[object]] = [["time [s]", "force [N]"], [0, 1], ["=A2+1", "=2*B2"], ["=A3+1", 2]]
    path = write_xlsx(tmp_path / "a.xlsx", rows)
    with pytest.raises(UserError) as caught:
        read_record(path)
    time, force = str(caught.value).splitlines()
    assert "column time, data row 2: '=A2+1' is a formula without a stored value (2 such" in time
    assert "column force, data row 2: '=2*B2' is a" in force and "program and save it" in force


@pytest.mark.parametrize(
    ("stored", "value"), [(b' t="str"><f>2*B2</f><v></v>', np.nan), (b"><f>2*B2</f><v>4</v>", 4.0)]
)
def test_excel_formulas_with_stored_values(tmp_path: Path, stored: bytes, value: float) -> None:
    rows: list[list[object]] = [["time [s]", "force [N]", ""], [0, 1, None], [1, "=2*B2", None]]
    path = write_xlsx(tmp_path / "a.xlsx", rows)
    rewritten(path, lambda xml: re.sub(rb"><f>2\*B2</f><v ?/>", stored, xml))
    np.testing.assert_array_equal(read_record(path).columns["force"], [1.0, value])


def test_excel_cut_sheet(tmp_path: Path) -> None:
    path = write_xlsx(tmp_path / "a.xlsx", [["time [s]", "force [N]"], [0, 1], [1, 2]])
    with pytest.raises(UserError, match=r"cannot be read as an Excel file.*copy it again"):
        read_record(rewritten(path, lambda xml: xml[:-60]))
