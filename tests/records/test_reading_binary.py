"""MATLAB and TDMS records give what the same csv gives."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from tests.shared.step_record import TIME, VOLTAGE_KV, check

from deabayes.faults import UserError
from deabayes.records.columns import from_text
from deabayes.records.record import read_record


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
        (None, ["no column has a unit; the file has 't', 'u'", "t = time [?]; u = voltage [?]"]),
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


def test_matlab_structures_and_matrices_are_named_as_in_matlab(tmp_path: Path) -> None:
    import scipy.io

    both = np.column_stack([TIME, VOLTAGE_KV])
    scipy.io.savemat(tmp_path / "a.mat", {"run": {"x": {"t": TIME}, "u": VOLTAGE_KV}, "m": both})
    write_mat_7_3(tmp_path / "b.mat", {"run/x/t": TIME, "run/u": VOLTAGE_KV, "m": both.T})
    for name in ("a.mat", "b.mat"):
        for text in ("run.x.t = time [s]; run.u = voltage [kV]",
                     "m(:,1) = time [s]; m(:,2) = voltage [kV]"):  # fmt: skip
            check(read_record(tmp_path / name, columns=from_text(text)))
        with pytest.raises(UserError, match=r"no variable 'm' but m\(:,1\), m\(:,2\); name one"):
            read_record(tmp_path / name, columns=from_text("m = time [s]"))
        with pytest.raises(UserError, match=r"run\.x\.t = time \[\?\]; run\.u = voltage \[\?\]"):
            read_record(tmp_path / name, needed=("time", "voltage"))


def test_matlab_arrays_of_structures(tmp_path: Path) -> None:
    import scipy.io

    kind = [("Name", object), ("Data", object)]
    signals = np.array([("laser", TIME), ("monitor", VOLTAGE_KV)], dtype=kind)
    scipy.io.savemat(tmp_path / "a.mat", {"rec": {"X": {"Data": TIME}, "Y": signals}})
    text = "rec.X.Data = time [s]; rec.Y(2).Data = voltage [kV]"
    check(read_record(tmp_path / "a.mat", columns=from_text(text)))


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


def test_tdms_line_breaks_within_the_names_of_channels(tmp_path: Path) -> None:
    channels = [("time\n[s]", TIME, {}), ("voltage [kV]", VOLTAGE_KV, {}), ("a\nb [N]", TIME, {})]
    record = read_record(write_tdms(tmp_path / "a.tdms", channels))  # type: ignore[arg-type]
    check(record)
    assert "a b" in record.columns


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
