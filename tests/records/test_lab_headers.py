"""Headers as instruments write them: read, or answered by one message with the lines to paste."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.study_folders import make_folder, record_lines, replace_in, write_lines

from deabayes.checks.folder import check_folder
from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record

ROWS = ["0;0;0,5;ok", "0,5;2,5;1,5;ok", "1;2,5;2;ok"]
PREAMBLE = ["Prüfstand 3", "Rate;20", "Datum;12.05.2024;10:00", "Kanal;1;2;3"]
NEEDED = ("time", "voltage", "displacement")


def written(path: Path, lines: list[str], mark: str = ";", encoding: str = "utf-8") -> Path:
    path.write_bytes("\r\n".join(lines).replace(";", mark).encode(encoding))
    return path


def check_values(path: Path, **settings: object) -> tuple[str, ...]:
    record = read_record(path, needed=NEEDED, **settings)  # type: ignore[arg-type]
    np.testing.assert_allclose(record.columns["time"], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(record.columns["voltage"], [0.0, 2500.0, 2500.0])
    np.testing.assert_allclose(record.columns["displacement"], [5e-4, 1.5e-3, 2e-3])
    return tuple(record.notes)


@pytest.mark.parametrize(
    "header",
    [
        ["Time (s);Voltage (kV);Displacement (mm);Flag"],
        ["TIME [s];Voltage [kV];displacement (mm);Flag"],
        ['"Time";"Voltage";"Displacement";"Flag"', '"s";"kV";"mm";""'],
        ["time;voltage;displacement;Flag", "(s);(kV);(mm);(-)"],
        ["time;voltage;displacement;Flag", "[s];[kV];[mm];"],
        ["time;voltage;displacement;Flag", "sec;kilovolt;millimeter;"],
    ],
)
@pytest.mark.parametrize("above", [[], PREAMBLE, ["", "# rig 3", *PREAMBLE, ""]])
@pytest.mark.parametrize("mark", [";", "\t"])
def test_units_in_the_header_or_below_it(
    tmp_path: Path, header: list[str], above: list[str], mark: str
) -> None:
    path = written(tmp_path / "a.csv", [*above, *header, *ROWS], mark)
    notes = check_values(path)
    assert notes[-1] == "left out: Flag"
    assert any("what is above it is left out" in note for note in notes) == bool(above)
    assert any("with units in line" in note for note in notes) == bool(header[1:])


def test_the_lines_of_header_and_units_are_those_of_the_file(tmp_path: Path) -> None:
    header = ["time;voltage;displacement;Flag", "s;kV;mm;"]
    path = written(tmp_path / "a.csv", ["", *PREAMBLE, "# about", *header, *ROWS])
    assert check_values(path)[0].startswith("header in line 7, with units in line 8;")


def test_empty_cells_at_both_ends_of_a_row(tmp_path: Path) -> None:
    rows = [f";{row.removesuffix('ok')};" for row in ROWS]
    header = "Mark;Time (s);Voltage (kV);Displacement (mm);Flag;"
    check_values(written(tmp_path / "a.csv", [header, *rows], "\t"))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_preamble_behind_a_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    lines = [*PREAMBLE, "Time (s);Voltage (kV);Displacement (mm);Flag", *ROWS]
    check_values(written(tmp_path / "a.csv", lines, encoding=encoding))


@pytest.mark.parametrize(
    ("header", "proposal"),
    [
        (
            ["Zeit (s);U (kV);x (mm);Flag"],
            "Zeit (s) = time [s]; U (kV) = voltage [kV]; x (mm) = displacement [mm]",
        ),
        (
            ["t / s;HV Monitor, kV;Laser in mm;Flag"],
            "t / s = time [s]; HV Monitor, kV = voltage [kV]; Laser in mm = displacement [mm]",
        ),
        (
            ["time [s];Spannung;Weg;Flag", ";kV;mm;"],
            "time [s]; Spannung = voltage [kV]; Weg = displacement [mm]",
        ),
        (
            ["time [s];Ch0 [kV];Ch1 [mm];Flag"],
            "time [s]; Ch0 [kV] = voltage [kV]; Ch1 [mm] = displacement [mm]",
        ),
    ],
)
def test_other_names_are_answered_by_lines_that_read_the_file(
    tmp_path: Path, header: list[str], proposal: str
) -> None:
    path = written(tmp_path / "a.csv", [*PREAMBLE, *header, *ROWS])
    with pytest.raises(UserError) as caught:
        check_values(path)
    assert str(caught.value).endswith(
        f"Put this into the column `columns` of experiments.csv: {proposal}"
    )
    assert "\n" not in str(caught.value)
    check_values(path, columns=from_text(proposal))


def test_what_the_file_does_not_say_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["Zeit;Kanal 1;Weg (mm);Flag", *ROWS])
    with pytest.raises(UserError, match="and replace each \\?: Zeit = time \\[\\?\\]; \\? = volt"):
        check_values(path)
    text = "Zeit = time [?]; Kanal 1 = voltage [kV]; Weg (mm) = displacement [mm]"
    with pytest.raises(UserError, match="column time: write its unit in place of the question m"):
        check_values(path, columns=from_text(text))
    check_values(path, columns=from_text(text.replace("?", "s")))


def test_another_unit_than_the_file_states_is_shown(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["Zeit (ms);Weg [mm]", "0;1", "1;2"])
    record = read_record(path, columns=from_text("Zeit = time [s]; Weg = displacement"))
    assert record.notes == ("columns Zeit (ms) = time [s]; Weg [mm] = displacement [mm]",)


def test_a_strain_is_a_stretch_less_one(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["Dehnung (%);Kraft (N)", "0;0", "50;1", "100;2"])
    proposal = r"Dehnung \(%\) = stretch - 1 \[%\]; Kraft \(N\) = force \[N\]"
    with pytest.raises(UserError, match=proposal):
        read_record(path, needed=("stretch", "force"))
    columns = from_text("Dehnung (%) = stretch - 1 [%]; Kraft (N) = force [N]")
    np.testing.assert_allclose(read_record(path, columns=columns).columns["stretch"], [1, 1.5, 2])


@pytest.mark.parametrize(
    "odd",
    ["strain (mm)", "Stress (KPa)", "current [TTL]", "Remark [s]", "time of day [h:m]", "area"],
)
def test_columns_that_no_row_uses_may_hold_anything(tmp_path: Path, odd: str) -> None:
    path = make_folder(tmp_path) / "records" / "relax.csv"
    head, *rows = record_lines(1)
    write_lines(
        path, [f"{head},{odd}", *(f"{row},N/A" for row in rows[:9]), *(f"{r},x" for r in rows[9:])]
    )
    report = check_folder(path.parents[1])
    assert report.ok
    assert f"  left out: {odd}\n" in report.text()


def test_check_shows_what_was_taken_from_the_header(tmp_path: Path) -> None:
    path = make_folder(tmp_path) / "records" / "relax.csv"
    _, *rows = record_lines(1)
    write_lines(path, ["Machine,7", "Time (s),Displacement (mm),FORCE [N]", *rows])
    text = check_folder(path.parents[1]).text()
    assert "header in line 2; what is above it is left out" in text
    taken = "Time (s) = time [s]; Displacement (mm) = displacement [mm]; FORCE [N] = force [N]"
    assert f"columns {taken}" in text


def test_a_voltage_is_never_left_out_in_silence(tmp_path: Path) -> None:
    path = make_folder(tmp_path) / "records" / "relax.csv"
    head, *rows = record_lines(1)
    write_lines(path, [f"{head},Voltage (kv)", *(f"{row},1" for row in rows)])
    assert "left out: Voltage (kv)" in check_folder(path.parents[1]).text()
    write_lines(path, [f"{head},voltage [kv]", *(f"{row},1" for row in rows)])
    (fault,) = check_folder(path.parents[1]).faults
    assert "unknown unit 'kv'; did you mean 'kV'?, or leave it out by `columns`: voltage" in fault


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (
            [*PREAMBLE, "Time (s);Voltage (kV)", *ROWS],
            "2 columns are named, but the first data row",
        ),
        (["(s);(kV);(mm);", *ROWS], "names no column; add it, or describe the columns"),
        ([*PREAMBLE, *ROWS], "no column|starts with numbers|only one column"),
        (["Time (s);Voltage (kV);x (mm);F", *ROWS, "Time;Voltage;x;F", *ROWS], "'Time' is not a n"),
        ([*PREAMBLE, "time [s];voltage [kV];displacement [mm];F", "0;0", *ROWS], "columns|differ"),
    ],
    ids=["too few names", "no names", "no header", "two measurements", "row cut short"],
)
def test_tables_that_are_not_certain(tmp_path: Path, lines: list[str], said: str) -> None:
    with pytest.raises(UserError, match=said):
        read_record(written(tmp_path / "a.csv", lines), columns=from_text("time [s]"))


def test_a_channel_that_two_columns_have(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time [s];Force (N);Force (kN)", "0;1;2", "1;2;3"])
    with pytest.raises(
        UserError, match=r"'force' occurs twice; leave one out .*: Force \(kN\) = -"
    ):
        read_record(path)
    record = read_record(path, columns=from_text("Force (kN) = -"))
    np.testing.assert_allclose(record.columns["force"], [1.0, 2.0])


def test_an_exact_name_comes_before_one_in_capitals(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["Time [h];time [s]", "0;1", "1;2"])
    record = read_record(path)
    np.testing.assert_allclose(record.columns["time"], [1.0, 2.0])
    np.testing.assert_allclose(record.columns["Time"], [0.0, 3600.0])


@pytest.mark.parametrize("first", ["1;V", "1;-", "1;s"])
def test_a_first_row_with_the_sign_of_a_unit_is_data(tmp_path: Path, first: str) -> None:
    path = written(tmp_path / "a.csv", ["time [s];Mode", first, "2;A", "3;V"])
    np.testing.assert_allclose(read_record(path).columns["time"], [1.0, 2.0, 3.0])


LINES = [*PREAMBLE, "# by hand", "time [s];voltage [kV];displacement [mm];Flag", *ROWS]
ABOVE = len(LINES) - len(ROWS)
COLUMNS = [{"name": "time", "unit": "s"}, {"name": "voltage", "unit": "kV"},
           {"name": "displacement", "unit": "mm"}, {"name": "-"}]  # fmt: skip


@pytest.mark.parametrize("count", range(ABOVE + len(ROWS) + 1))
@pytest.mark.parametrize("described", [False, True])
def test_no_number_of_header_lines_loses_a_sample(
    tmp_path: Path, count: int, described: bool
) -> None:
    path = written(tmp_path / "a.csv", LINES)
    settings = {"header_lines": count, **({"columns": COLUMNS} if described else {})}
    right = [ABOVE] if described else range(ABOVE)
    if count in right:
        check_values(path, record_format=settings)
        return
    with pytest.raises(UserError) as caught:
        read_record(path, settings)
    known = count < ABOVE + len(ROWS) and (count > ABOVE or count == ABOVE - 1)
    if described and known:
        assert f"header_lines: {ABOVE}" in str(caught.value)
    if not described and count < len(LINES) - 1:
        assert "state fewer, or remove it, as the header is found" in str(caught.value)


@pytest.mark.parametrize("first", ["0;0;0,5;", ";0;0,5;ok", "0;n/a;0,5;ok", "0;0;0,5;ok\n# about"])
def test_a_first_row_with_gaps_is_not_taken_for_a_header(tmp_path: Path, first: str) -> None:
    path = written(tmp_path / "a.csv", ["t;U;x;Flag", *first.split("\n"), *ROWS[1:]])
    count = 2 + first.count("\n")
    with pytest.raises(UserError, match="which is data; state header_lines: 1"):
        read_record(path, {"header_lines": count, "columns": COLUMNS})


def test_a_wrong_name_in_the_table_is_named(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "note,", "columns,")
    replace_in(folder / "experiments.csv", ",first,", ",Kraft = force,")
    (fault,) = check_folder(folder).faults
    assert "no column is called 'Kraft', as `columns` in experiments.csv says" in fault
