"""Text records: what is read, and how a broken file is named."""

from __future__ import annotations

import hashlib
import re
import time
from pathlib import Path

import numpy as np
import pytest
from tests.shared.plain_record import PLAIN

from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record


def check_plain(path: Path) -> None:
    record = read_record(path)
    assert list(record.columns) == ["time", "voltage", "displacement"]
    np.testing.assert_allclose(record.columns["time"], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(record.columns["voltage"], [0.0, 2500.0, 2500.0])
    np.testing.assert_allclose(record.columns["displacement"], [5e-4, 1.5e-3, 2e-3])
    assert record.units == {"time": "s", "voltage": "V", "displacement": "m"}
    assert record.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    "content",
    [
        PLAIN.encode(),
        PLAIN.encode("utf-8-sig"),
        PLAIN.replace("\n", "\r\n").encode(),
        PLAIN.replace("\n", "\r").encode(),
        PLAIN.replace(",", ";").encode(),
        PLAIN.replace(",", "\t").encode(),
        PLAIN.replace(",", ";").replace(".", ",").encode(),
        PLAIN.replace(",", "\t").replace(".", ",").encode(),
        b"time [s];voltage [kV];displacement [mm]\n0;0;0,5\n0,5;2,5;1,5\n1;2,5;2\n",
        b"time [s],voltage [kV],displacement [mm]\n"
        b'"0","0","0,5"\n"0,5","2,5","1,5"\n"1","2,5","2"\n',
        b"# made up\n\n" + PLAIN.replace("\n0.5,", "\n# half way\n\n0.5,").encode(),
        PLAIN.replace("\n", ",\n").encode(),
        PLAIN.rstrip("\n").encode(),
        PLAIN.encode() + b"\n\n\r\n",
        PLAIN.replace("displacement [mm]", " displacement [ mm ] ").encode(),
        b"sep=;\r\n" + PLAIN.replace(",", ";").encode(),
    ],
    ids=[
        "plain", "byte order mark", "carriage returns", "carriage returns only", "semicolon", "tab",
        "semicolon, comma",
        "tab, comma", "late decimal comma", "quoted decimal comma", "comments", "trailing comma",
        "no newline at the end", "empty lines at the end", "blanks in the header",
        "Excel's separator line",
    ],
)  # fmt: skip
def test_ways_to_write_the_same_record(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    check_plain(path)


def test_decimal_comma_far_down_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{i};{i}" for i in range(200)] + ["200,5;3,5"]
    path.write_text("time [s];force [N]\n" + "\n".join(rows), encoding="utf-8")
    assert read_record(path).columns["time"][-1] == 200.5


def test_unknown_column_keeps_its_unit_and_one_without_unit_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    header = "time [s],force [N],oven [degC],remark,force (raw),trigger [TTL],sample [#],on [d.m.y]"
    rows = "0,1,20,ok,7,0,1,1.5.2024\n1,2,21,,8,5,2,1.5.2024"
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    record = read_record(path)
    assert set(record.columns) == {"time", "force", "oven"}
    assert record.columns["oven"][0] == pytest.approx(293.15)


def test_a_known_column_is_left_out_by_its_row(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time [s],current [TTL]\n0,1\n1,2\n", encoding="utf-8")
    assert set(read_record(path, columns=from_text("current = -")).columns) == {"time"}
    with pytest.raises(UserError, match="column current: unknown unit 'TTL'"):
        read_record(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["is empty", "copy the record again"]),
        (b"\n# only a comment\n", ["nothing but empty lines"]),
        (b"time [s],force [N]\n", ["no data rows"]),
        (b"time [s]|force [N]\n0|1\n", ["only one column", "time [s]|force [N]", "a comma"]),
        (b"time [s],force [N]\n0;1\n1;2\n", ["first data row '0;1' has 1", "delimiter"]),
        (b"time,force\n0,1\n", ["has a unit", "experiments.csv, and replace each ?: time [?]; fo"]),
        (b"Zeit,Kraft in N\n0,1\n", ["has a unit", "Zeit = time [?]; Kraft in N = force [N]"]),
        (b"time [s],force\n0,1\n", ["column force", "no unit", "'force [N]'"]),
        (b"0,1\n1,2\n", ["starts with numbers", "record_format"]),
        (b"0,0;-0,5;1,5\n", ["starts with numbers", "record_format"]),
        (b"# rig\n0,1\n1,2\n", ["starts with numbers", "add it, or describe"]),
        (
            b"\xef\xbb\xbf# time [s],force [N]\n\n0,1\n1,2\n",
            ["starts with numbers ('0,1')", "remove the '#' before 'time [s],force [N]'"],
        ),
        (b"time [s],force [Nn]\n0,1\n1,2\n", ["column force", "unknown unit 'Nn'", "as pint does"]),
        (b"time [s],force [V]\n0,1\n1,2\n", ["column force", "a voltage", "a force"]),
        (b"time [s],force [N]\n0,1\n1,2\n2", ["last row '2' has 1 of 2", "truncated"]),
        (b"time [s],force [N]\n0,1\n1,2,3\n2,3\n", ["differ in their number", "line 2"]),
        (b"time [s],force [N]\n0,1\n1,ERR\n2,3\n", ["column force, data row 2", "'ERR'"]),
        (b"time [s],force [N],force [N]\n0,1,1\n1,2,2\n", ["'force' occurs twice"]),
        (b"time [s],Kraft \xfc [N]\n0,1\n1,2\n", ["line 1", "not UTF-8", "0xfc", "save the file"]),
        ("time [s],a [m]\n".encode("utf-16-le"), ["without a byte order mark", "utf-16-le}"]),
        ("time [s],a [m]\n".encode("utf-16-be"), ["without a byte order mark", "utf-16-be}"]),
        (b"PK\x03\x04\xff\xfe\n0,1\n", ["not a text file", "Excel workbook", "name a workbook"]),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", ["old Excel workbook", "export it as CSV"]),
        (b"\x89HDF\r\n", ["not a text file", "name that .mat"]),
        (b"\xfa\x00\x01\x02", ["not a text file", "null bytes", "export it as CSV"]),
    ],
)
def test_broken_files_are_named_with_a_remedy(
    tmp_path: Path, content: bytes, words: list[str]
) -> None:
    path = tmp_path / "broken.csv"
    path.write_bytes(content)
    with pytest.raises(UserError) as caught:
        read_record(path)
    for word in ["broken.csv", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "clock", ["2024-05-13 10:00:00", "13.5.24", "5/13/2024 9:00", "10:00:00.5", "09:59"]
)
def test_dates_and_clock_times(tmp_path: Path, clock: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"time [s],force [N]\n{clock},1\n{clock},2\n", encoding="utf-8")
    said = f"{clock!r} is a date or a clock time (2 such rows); give seconds since the first row"
    with pytest.raises(UserError, match=rf"column time, data row 1: {re.escape(said)}"):
        read_record(path)


@pytest.mark.parametrize(
    "error", "#N/A #NV #DIV/0! #VALUE! #WERT! #REF! #BEZUG! #NUM! #ZAHL! #NAME? 1.#QNAN".split()
)
@pytest.mark.parametrize("row", ["{},2", "2,{}", '"{}",2', "{},{}"])
def test_excel_errors_are_no_comments(tmp_path: Path, error: str, row: str) -> None:
    path = tmp_path / "a.csv"
    rows = ["# about", "0,1  # remark", "1,2", row.replace("{}", error), "3,4"]
    path.write_text("time [s],force [N]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    with pytest.raises(UserError, match=rf"data row 3: '{re.escape(error)}' is not a number"):
        read_record(path)


def test_excel_error_in_a_column_that_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = ['#N/A,"no. #1",0,1', "ok,,1,2 # half way", "#NV,,2,3"]
    path.write_text("a,b,time [s],force [N]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    np.testing.assert_allclose(read_record(path).columns["force"], [1.0, 2.0, 3.0])


def test_blank_lines_at_the_end_count_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(PLAIN.encode() + b"\n" * 20000)
    check_plain(path)


def test_endless_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"time [s]," + b"x" * 200_000)
    with pytest.raises(UserError, match=r"a\.csv: is not a table"):
        read_record(path)


def test_all_faults_of_a_header_come_together(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time [m],voltage [kv],force [N]\n0,1,x\n1,2,3\n", encoding="utf-8")
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert len(str(caught.value).splitlines()) == 3


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"gone\.csv: there is no such file"):
        read_record(tmp_path / "gone.csv")


def test_a_folder_is_no_record(tmp_path: Path) -> None:
    with pytest.raises(UserError) as told:
        read_record(tmp_path)
    assert str(told.value) == f"{tmp_path}: is a folder; name the file of the record"


def test_a_long_record_is_read_quickly(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    block = "".join(f"{i * 1e-4:.4f},2.5,{i * 1e-6:.6f}\n" for i in range(100_000))
    path.write_text("time [s],voltage [kV],strain [%]\n" + block * 5, encoding="utf-8")
    start = time.perf_counter()
    record = read_record(path)
    assert record.columns["strain"].size == 500_000
    assert time.perf_counter() - start < 5.0  # 0.2 s when measured; a Python loop takes longer
