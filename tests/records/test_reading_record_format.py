"""Text records whose form is stated: delimiter, encoding, lines above the header, columns."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tests.shared.plain_record import PLAIN

from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record

REAL_DATA = Path(os.environ.get("DEABAYES_DATA", Path(__file__).parents[3] / "shared" / "data"))
ZHAO = {
    "encoding": "gbk",
    "delimiter": ",",
    "header_lines": 2,
    "columns": [
        {"name": "time", "unit": "s"},
        {"name": "displacement", "unit": "mm"},
        {"name": "force", "unit": "N"},
    ],
}


@pytest.mark.parametrize(
    ("delimiter", "mark"),
    [(", ", ","), ("comma", ","), ("semicolon", ";"), ("tab", "\t"), ("\t", "\t"), (";", ";")],
)
def test_named_delimiters(tmp_path: Path, delimiter: str, mark: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace(",", mark), encoding="utf-8")
    assert read_record(path, {"delimiter": delimiter}).columns["time"].size == 3


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "utf-16", "utf-16-be", "utf-32"])
def test_encoding_of_the_header(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("time [s],displacement [µm]\n0,1\n1,2\n".encode(encoding))
    record = read_record(path, {"encoding": encoding})
    np.testing.assert_allclose(record.columns["displacement"], [1e-6, 2e-6])


def test_utf_16_without_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("time [s],force [N]\n0,1\n1,2\n".encode("utf-16-le"))
    assert read_record(path, {"encoding": "utf-16"}).columns["time"].size == 2


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("stated", [{}, {"encoding": "latin-1"}, {"encoding": "utf-16"}])
def test_a_byte_order_mark_says_more_than_what_is_stated(
    tmp_path: Path, encoding: str, stated: dict[str, str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(PLAIN.encode(encoding))
    assert list(read_record(path, stated).columns) == ["time", "voltage", "displacement"]


def test_an_encoding_stated_for_a_file_of_another(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(PLAIN, encoding="utf-8")
    with pytest.raises(UserError, match=r"a\.csv: is not utf-16, which specimen\.yaml states"):
        read_record(path, {"encoding": "utf-16"})


@pytest.mark.parametrize("above", ["rig 7\n", "# rig 7\n", "\nrig; 7, [s]\n\n"])
def test_header_lines_without_columns_stand_above_the_header(tmp_path: Path, above: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"made on Monday, by hand\n{above}{PLAIN}", encoding="utf-8")
    assert list(read_record(path, {"header_lines": 2}).columns)[1:] == ["voltage", "displacement"]
    with pytest.raises(UserError, match=r"counts the lines above the header .* state fewer"):
        read_record(path, {"header_lines": 3})


def test_the_line_of_an_unreadable_header_below_others(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"\nrig\n\nZeit \xfc [s],a [m]\n0,1\n")
    with pytest.raises(UserError, match=r"a\.csv, line 4: the header is not UTF-8"):
        read_record(path, {"header_lines": 1})


@pytest.mark.parametrize(
    "header", ["Zeit;Hoch spannung;Weg [m]", "Zeit [h];Hoch spannung [V];Weg [m]"]
)
def test_columns_that_the_table_names(tmp_path: Path, header: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{header}\n0;0;0,0005\n0,5;2,5;0,0015\n1;2,5;0,002\n", encoding="utf-8")
    named = from_text("Zeit = time [s]; Hoch spannung = voltage [kV]; Weg = displacement")
    record = read_record(path, columns=named)
    np.testing.assert_allclose(record.columns["voltage"], [0.0, 2500.0, 2500.0])
    np.testing.assert_allclose(record.columns["displacement"], [5e-4, 1.5e-3, 2e-3])
    np.testing.assert_allclose(record.columns["time"], [0.0, 0.5, 1.0])
    with pytest.raises(UserError, match=r"no column is called 'Wege', as `columns` .*'Weg'"):
        read_record(path, columns=from_text("Wege = displacement [m]"))


@pytest.mark.parametrize(
    ("mark", "cells"),
    [(",", ['"2,000"', '"-12,500"']), (";", ["2,000", "300"]), ("\t", ["2,000", "1,500"])],
)
def test_commas_that_may_separate_thousands(tmp_path: Path, mark: str, cells: list[str]) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{i}{mark}{cell}\n" for i, cell in enumerate(cells)]
    path.write_text(f"time [s]{mark}voltage [V]\n{''.join(rows)}", encoding="utf-8")
    with pytest.raises(UserError, match=r"a\.csv: 2,000 may be 2000 or 2\.000; .*decimal: ','"):
        read_record(path)
    assert read_record(path, {"decimal": ","}).columns["voltage"][0] == 2.0
    with pytest.raises(UserError, match=r"'2,000' has a decimal comma .* separators of thousands"):
        read_record(path, {"decimal": "."})


@pytest.mark.parametrize("other", ["0,125", "-0,125", "1,25", "1000,125", "1,2500"])
def test_one_decimal_comma_decides(tmp_path: Path, other: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"time [s];voltage [V]\n0;1,250\n1;{other}\n2;3,000\n", encoding="utf-8")
    decimal = float(other.replace(",", "."))
    np.testing.assert_allclose(read_record(path).columns["voltage"], [1.25, decimal, 3.0])


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (["0,5", "2.500"], r"data row 2: '2\.500' has a decimal point .* with a decimal comma"),
        (["500", "2.500"], r"data row 2: '2\.500' has a decimal point .* separators of thousands"),
        (["0,5", "1.250,5"], r"data row 2: '1\.250,5' is not a number \(1 such rows\)"),
        (["0,5", "1.5.2024"], r"data row 2: '1\.5\.2024' is a date"),
    ],
)
def test_points_among_decimal_commas(tmp_path: Path, cells: list[str], words: str) -> None:
    """2.500 is two thousand and a half, or the other way round."""
    path = tmp_path / "a.csv"
    rows = [f"{i},5;{cell}\n" for i, cell in enumerate(cells)]
    path.write_text(f"time [s];voltage [V]\n{''.join(rows)}", encoding="utf-8")
    with pytest.raises(UserError, match=rf"a\.csv, column voltage, {words}"):
        read_record(path, {"decimal": ","})


def test_columns_that_change_places(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    swapped = PLAIN.replace("voltage [kV],displacement [mm]", "displacement [mm],voltage [kV]")
    path.write_text(swapped, encoding="utf-8")
    named = from_text("voltage = displacement [mm]; displacement = voltage [kV]")
    record = read_record(path, columns=named)
    np.testing.assert_allclose(record.columns["voltage"], [0.0, 2500.0, 2500.0])
    np.testing.assert_allclose(record.columns["displacement"], [5e-4, 1.5e-3, 2e-3])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"encoding": "utf-32-foo"}, ["record_format.encoding", "'utf-32-foo'", "latin-1"]),
        ({"encoding": "hex"}, ["record_format.encoding", "'hex'"]),
        ({"delimiter": "ab"}, ["record_format.delimiter", "'ab'", "tab"]),
        ({"delimiter": '"'}, ["record_format.delimiter"]),
    ],
)
def test_record_format_that_is_none(
    tmp_path: Path, settings: dict[str, str], words: list[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(PLAIN, encoding="utf-8")
    with pytest.raises(UserError) as caught:
        read_record(path, settings)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("start", ["", "\r\n"])
def test_described_record_with_unreadable_header(tmp_path: Path, start: str) -> None:
    path = tmp_path / "a.csv"
    head = f"{start}时间,位移,力\r\n(s),(mm),(N)\r\n".encode("gbk")
    path.write_bytes(head + b'"0.0","0.5","1.0"\r\n"0.1","0.6","1.1"\r\n\r\n\r\n')
    record = read_record(path, ZHAO)
    np.testing.assert_allclose(record.columns["displacement"], [5e-4, 6e-4])
    assert record.columns["force"][1] == 1.1


def test_columns_left_out_and_offset(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("meta;1\nmore\n0,1;50;7\n0,2;60;8\n", encoding="utf-8")
    columns = [{"name": "-"}, {"name": "stretch", "unit": "%", "offset": 1.0}, {"name": None}]
    record = read_record(path, {"header_lines": 2, "columns": columns})
    assert list(record.columns) == ["stretch"]
    np.testing.assert_allclose(record.columns["stretch"], [1.5, 1.6])


def test_white_space_without_header(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("    0.1    1.03\r\n    0.2    1.12", encoding="utf-8")
    columns = [{"name": "nominal_stress", "unit": "MPa"}, {"name": "stretch", "unit": "1"}]
    record = read_record(path, {"delimiter": "whitespace", "columns": columns})
    np.testing.assert_allclose(record.columns["nominal_stress"], [1e5, 2e5])


@pytest.mark.parametrize(
    ("header_lines", "words"),
    [(0, ["holds no number", "header_lines"]), (2, ["which is data", "header_lines"])],
)
def test_wrong_number_of_header_lines(tmp_path: Path, header_lines: int, words: list[str]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;F\n0;1\n1;2\n2;3\n", encoding="utf-8")
    columns = [{"name": "time", "unit": "s"}, {"name": "force", "unit": "N"}]
    with pytest.raises(UserError) as caught:
        read_record(path, {"header_lines": header_lines, "columns": columns})
    for word in words:
        assert word in str(caught.value)


def test_described_two_byte_text(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("t;F\n0;1\n1;2\n".encode("utf-16"))
    columns = [{"name": "time", "unit": "s"}, {"name": "force", "unit": "mN"}]
    record = read_record(path, {"encoding": "utf-16", "header_lines": 1, "columns": columns})
    np.testing.assert_allclose(record.columns["force"], [1e-3, 2e-3])


@pytest.mark.skipif(not (REAL_DATA / "vhb4910_zhao").is_dir(), reason="public data not here")
def test_every_vhb4910_record_reads() -> None:
    paths = sorted((REAL_DATA / "vhb4910_zhao" / "raw").glob("*/*.csv"))
    assert len(paths) == 18
    for path in paths:
        record = read_record(path, ZHAO)
        assert np.all(np.diff(record.columns["time"]) > 0.0)
        assert 0.03 < record.columns["displacement"].max() < 0.41
        assert 0.6 < record.columns["force"].max() < 4.0
        assert all(np.isfinite(values).all() for values in record.columns.values())


@pytest.mark.skipif(not (REAL_DATA / "soft_silicones_srmd").is_dir(), reason="public data not here")
def test_every_silicone_record_reads() -> None:
    names = ("-", "-", "-", "stretch", "nominal_stress")
    units = (None, None, None, "1", "MPa")
    columns = [{"name": n, "unit": u} for n, u in zip(names, units, strict=True)]
    columns[3]["offset"] = 1.0
    paths = sorted((REAL_DATA / "soft_silicones_srmd").glob("*.csv"))
    assert len(paths) == 8
    for path in paths:
        record = read_record(path, {"delimiter": ";", "header_lines": 18, "columns": columns})
        assert 1.0 < record.columns["stretch"].min() < 1.1
        assert 5e5 < record.columns["nominal_stress"].max() < 5e6
