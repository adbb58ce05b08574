"""Excel, MATLAB and TDMS records give what the same csv gives."""

from __future__ import annotations

import re
import struct
import zipfile
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from deabayes.faults import UserError
from deabayes.reading.columns import from_text
from deabayes.reading.raw import RawRecord
from deabayes.reading.records import read_record

TIME = np.array([0.0, 0.5, 1.0])
VOLTAGE_KV = np.array([0.0, 2.5, 2.5])


def check(record: RawRecord) -> None:
    np.testing.assert_allclose(record.columns["time"], TIME)
    np.testing.assert_allclose(record.columns["voltage"], 1e3 * VOLTAGE_KV)
    assert record.units["voltage"] == "V"
    assert len(record.sha256) == 64


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
            "the last header line is '0.5, 2.5, 1', which is data; correct h",
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


def test_line_breaks_within_the_cells_of_a_header(tmp_path: Path) -> None:
    rows = [["time\n[s]", "Hoch\r\nspannung [V]"], *zip(TIME, VOLTAGE_KV, strict=True)]
    path = write_xlsx(tmp_path / "a.xlsx", [list(row) for row in rows])
    check(read_record(path, columns=from_text("Hoch spannung = voltage\n[kV]")))
    channels = [("time\n[s]", TIME, {}), ("voltage\n[kV]", VOLTAGE_KV, {})]
    check(read_record(write_tdms(tmp_path / "a.tdms", channels)))  # type: ignore[arg-type]


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


def test_excel_title_above_the_header(tmp_path: Path) -> None:
    rows: list[list[object]] = [["Run 7"], ["time [s]", "force [N]"], [0, 1]]
    with pytest.raises(UserError, match=r"no column of the first row 'Run 7' has a unit.*titles"):
        read_record(write_xlsx(tmp_path / "a.xlsx", rows))


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


def test_matlab_with_columns_of_the_row(tmp_path: Path) -> None:
    import scipy.io

    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": TIME[:, None], "voltage": VOLTAGE_KV, "junk": "text"})
    check(read_record(path, columns=from_text("t = time [s]; voltage [kV]")))


def test_matlab_with_columns_of_the_specimen(tmp_path: Path) -> None:
    import scipy.io

    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": TIME, "u": VOLTAGE_KV})
    columns = [
        {"name": "time", "unit": "s", "source": "t"},
        {"name": "voltage", "unit": "kV", "source": "u"},
    ]
    check(read_record(path, {"columns": columns}))


def test_matlab_7_3(tmp_path: Path) -> None:
    variables = {"t": TIME[None, :], "u": VOLTAGE_KV[None, :]}
    path = write_mat_7_3(tmp_path / "a.mat", variables)
    check(read_record(path, columns=from_text("t = time [s]; u = voltage [kV]")))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, ["holds no units", "experiments.csv", "t, u"]),
        ("t = time [s]; w = voltage [kV]", ["no variable 'w'"]),
        ("t = time [s]; u = voltage [kV]", ["differ in length", "time 3", "voltage 2"]),
    ],
)
def test_matlab_faults(tmp_path: Path, text: str | None, words: list[str]) -> None:
    import scipy.io

    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": TIME, "u": VOLTAGE_KV[:2]})
    with pytest.raises(UserError) as caught:
        read_record(path, columns=None if text is None else from_text(text))
    for word in ["a.mat", *words]:
        assert word in str(caught.value)


V7_3 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
COMPLEX = np.array([(1.0, 2.0)] * 3, dtype=[("real", float), ("imag", float)])


def test_a_matlab_7_3_file_cut_short_is_named(tmp_path: Path) -> None:
    path = write_mat_7_3(tmp_path / "a.mat", {"t": TIME, "u": VOLTAGE_KV})
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(UserError, match=r"a.mat: cannot be read as a MATLAB file .* copy it again"):
        read_record(path, columns=from_text("t = time [s]; u = voltage [kV]"))


def write_mat_7_3(path: Path, variables: dict[str, object]) -> Path:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            file[name] = values
    with path.open("r+b") as stream:
        stream.write(V7_3)
    return path


def test_matlab_complex_numbers(tmp_path: Path) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "a.mat", {"t": TIME, "u": VOLTAGE_KV * 1j})
    write_mat_7_3(tmp_path / "b.mat", {"t": TIME, "u": COMPLEX})
    for name in ("a.mat", "b.mat"):
        with pytest.raises(UserError, match="column voltage: holds complex numbers; save its mod"):
            read_record(tmp_path / name, columns=from_text("t = time [s]; u = voltage [kV]"))


def test_matlab_structures(tmp_path: Path) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "a.mat", {"run": {"t": TIME, "u": VOLTAGE_KV}})
    write_mat_7_3(tmp_path / "b.mat", {"run/t": TIME, "run/u": VOLTAGE_KV})
    for name in ("a.mat", "b.mat"):
        for columns in (from_text("t = time [s]"), from_text("run = time [s]"), None):
            with pytest.raises(UserError, match=r"holds no variables but structures \(run\); save"):
                read_record(tmp_path / name, columns=columns)


def test_matlab_structures_beside_variables(tmp_path: Path) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "a.mat", {"run": {"t": TIME, "u": VOLTAGE_KV}, "rate": TIME})
    write_mat_7_3(tmp_path / "b.mat", {"run/t": TIME, "run/u": VOLTAGE_KV, "rate": TIME})
    for name in ("a.mat", "b.mat"):
        assert read_record(tmp_path / name, columns=from_text("rate = time [s]; run = -")).columns
        with pytest.raises(UserError) as caught:
            read_record(tmp_path / name, columns=from_text("t = time [s]"))
        assert "holds no variable 't'; known: rate" in str(caught.value)
        assert f"{name}: holds structures (run); save their fields as v" in str(caught.value)
        assert "(save('file.mat', '-struct', 'run'))" in str(caught.value)


def test_matlab_structures_in_a_cell_array(tmp_path: Path) -> None:
    import scipy.io

    cells = np.array([{"t": TIME}, "text"], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", {"runs": cells})
    with pytest.raises(UserError, match="column time: holds structures; save their fields"):
        read_record(tmp_path / "a.mat", columns=from_text("runs = time [s]"))


def write_tdms(path: Path, channels: list[tuple[str, np.ndarray, dict[str, object]]]) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("g", n, v, properties=p) for n, v, p in channels])
    return path


def test_tdms_units_from_names_or_properties(tmp_path: Path) -> None:
    channels = [("time [s]", TIME, {}), ("voltage", VOLTAGE_KV, {"unit_string": "kV"})]
    check(read_record(write_tdms(tmp_path / "a.tdms", channels)))  # type: ignore[arg-type]


def test_tdms_time_from_the_increment(tmp_path: Path) -> None:
    properties = {"wf_increment": 0.5, "wf_start_offset": 0.0, "wf_samples": 3}
    channels = [("voltage [kV]", VOLTAGE_KV, properties)]
    check(read_record(write_tdms(tmp_path / "a.tdms", channels)))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["a.xlsx", "a.mat", "a.tdms"])
@pytest.mark.parametrize("content", [b"", b"this is no such file at all, only text" * 20])
def test_damaged_files(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"copy"):
        read_record(path, columns=from_text("time [s]"))


def test_tdms_cut_anywhere_in_its_second_segment(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    channels: dict[str, tuple[np.ndarray, dict]] = {
        "time [s]": (TIME, {}),
        "voltage [kV]": (VOLTAGE_KV, {}),
    }
    path = write_groups(tmp_path / "a.tdms", {"g": channels})
    first = path.stat().st_size
    content = write_groups(path, {"g": channels, "h": channels}).read_bytes()
    data = len(content) - 2 * TIME.nbytes
    for end in (first + 10, first + 40, data, data + TIME.nbytes, len(content) - 1):
        path.write_bytes(content[:end])
        with pytest.raises(UserError, match="it is truncated; copy it again"):
            read_record(path)
    assert not caplog.records


@pytest.mark.parametrize(("cut", "said"), [(0, "holds no channels"), (1, "is truncated")])
def test_tdms_lengths_of_a_big_endian_file(tmp_path: Path, cut: int, said: str) -> None:
    big_endian_with_metadata, no_objects = 1 << 6 | 1 << 1, struct.pack(">L", 0)
    lead_in = struct.pack("<4sL", b"TDSm", big_endian_with_metadata)
    lead_in += struct.pack(">LQQ", 4713, len(no_objects), len(no_objects))
    (tmp_path / "a.tdms").write_bytes((lead_in + no_objects)[: len(lead_in) + 4 - cut])
    with pytest.raises(UserError, match=said):
        read_record(tmp_path / "a.tdms")


def write_groups(path: Path, groups: dict[str, dict[str, tuple[np.ndarray, dict]]]) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for group, channels in groups.items():
            writer.write_segment(
                [ChannelObject(group, n, v, properties=p) for n, (v, p) in channels.items()]
            )
    return path


@pytest.mark.parametrize(
    ("other", "found"),
    [
        ({"wf_increment": 0.2, "wf_start_offset": 5.0}, "every 0.2 s, start 5 s"),
        ({"wf_increment": 0.1, "wf_start_offset": 5.0}, "every 0.1 s, start 5 s"),
        ({}, "not stated"),
    ],
)
def test_tdms_channels_of_different_sampling(
    tmp_path: Path, other: dict[str, float], found: str
) -> None:
    usual = {"wf_increment": 0.1, "wf_start_offset": 0.0}
    channels = [("displacement [mm]", TIME, usual), ("force [N]", TIME, other)]
    path = write_tdms(tmp_path / "a.tdms", channels)  # type: ignore[arg-type]
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert "channels displacement [mm] and force [N] have different sampling" in str(caught.value)
    assert "every 0.1 s, start 0 s" in str(caught.value) and found in str(caught.value)


def test_tdms_with_a_time_of_its_own_needs_no_sampling(tmp_path: Path) -> None:
    channels = [("time [s]", TIME, {}), ("force [N]", TIME, {"wf_increment": 1.0})]
    path = write_tdms(tmp_path / "a.tdms", [*channels, ("voltage [kV]", VOLTAGE_KV, {})])  # type: ignore[list-item]
    check(read_record(path))


def test_tdms_channel_that_two_groups_have(tmp_path: Path) -> None:
    sampling = {"wf_increment": 0.5, "wf_start_offset": 0.0}
    path = write_groups(
        tmp_path / "a.tdms",
        {"run1": {"F": (TIME, sampling)}, "run2": {"F": (2 * TIME, sampling)}},
    )
    with pytest.raises(UserError, match=r"'F' is in groups run1 and run2; name one.*'run1/F = f"):
        read_record(path, columns=from_text("time [s]; F = force [N]"))
    record = read_record(path, columns=from_text("time [s]; run2/F = force [N]"))
    np.testing.assert_allclose(record.columns["force"], 2 * TIME)
    np.testing.assert_allclose(record.columns["time"], TIME)


def test_tdms_channel_named_with_its_only_group(tmp_path: Path) -> None:
    sampling = {"wf_increment": 0.5}
    path = write_groups(tmp_path / "a.tdms", {"run1": {"u": (VOLTAGE_KV, sampling)}})
    check(read_record(path, columns=from_text("time [ms]; run1/u = voltage [kV]")))
