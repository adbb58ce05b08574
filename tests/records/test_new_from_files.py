"""`deabayes new NAME --from FILE...`: a study folder of instruments' files, guesses marked."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from deabayes.checks.folder import check_folder
from deabayes.cli.main import main
from deabayes.faults import UserError
from deabayes.records.folder import read_folder
from deabayes.records.specimen import read_specimen

TIME = np.arange(0.0, 60.0, 0.25)
STEP_KV = np.where(TIME >= 2.0, 3.0, 0.0)
STEP_MM = np.where(TIME >= 2.0, 0.8 + 0.4 * (1.0 - np.exp(-(TIME - 2.0) / 8.0)), 0.0)
SINE_KV = 1.5 * (1.0 - np.cos(0.2 * np.pi * TIME))
HOLD_MM = np.minimum(20.0 * TIME, 40.0)
PULL_MM = np.minimum(TIME, 60.0 - TIME)
SWEEP_KV = 1.5 * (1.0 - np.cos(0.01 * np.pi * TIME**2))


def noisy(values: np.ndarray, seed: int = 1) -> np.ndarray:
    return values + 1e-3 * np.random.default_rng(seed).standard_normal(values.shape)


def text_file(
    head: list[str],
    *columns: np.ndarray,
    mark: str = ";",
    decimal: str = ",",
    encoding: str = "utf-8",
) -> Callable[[Path], Path]:
    """Write lines above and rows of numbers below."""

    def write(path: Path) -> Path:
        rows = [mark.join(f"{v:.5f}" for v in row) for row in zip(*columns, strict=True)]
        body = "\n".join(
            [line.replace(";", mark) for line in head] + [r.replace(".", decimal) for r in rows]
        )
        path.write_bytes(body.encode(encoding))
        return path

    return write


def xlsx(path: Path) -> Path:
    from openpyxl import Workbook

    workbook = Workbook()
    for row in (
        ["Export"],
        ["Operator", "KW"],
        ["Time", "Extension", "Load"],
        ["(sec)", "(mm)", "(N)"],
    ):
        workbook.active.append(row)
    for values in zip(TIME, HOLD_MM, noisy(0.01 * HOLD_MM), strict=True):
        workbook.active.append([float(value) for value in values])
    workbook.save(path)
    return path


def tdms(path: Path) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    sampling = {"wf_increment": 0.25, "wf_start_offset": 0.0}
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject("g", name, values, properties={**sampling, "unit_string": unit})
            for name, values, unit in (
                ("HV Monitor", STEP_KV, "kV"), ("Laser", noisy(STEP_MM), "mm"),
            )
        ])  # fmt: skip
    return path


def mat(path: Path) -> Path:
    import scipy.io

    scipy.io.savemat(path, {"run": {"t": TIME, "U": STEP_KV, "x": noisy(STEP_MM)}})
    return path


LABVIEW_LIKE = text_file(
    ["Prüfstand;3", "Rate;4", "", "Zeit (s);U (kV);x (mm)"], TIME, STEP_KV, noisy(STEP_MM),
    mark="\t", encoding="cp1252",
)  # fmt: skip
TENSILE = text_file(
    ['"Probe";"A3"', '"Datum";"12.5.24"', "", '"Zeit";"Dehnweg";"Standardkraft"', '"s";"mm";"N"'],
    TIME, PULL_MM, noisy(0.01 * PULL_MM),
)  # fmt: skip
CASES = {
    "labview.csv": (LABVIEW_LIKE, "membrane", "creep?", ("voltage", "displacement")),
    "tensile.txt": (TENSILE, None, "load_unload?", ("displacement", "force")),
    "hold.xlsx": (xlsx, None, "relaxation?", ("displacement", "force")),
    "step.tdms": (tdms, "tubular", "creep?", ("voltage", "displacement")),
    "run.mat": (mat, "tubular", "creep?", ("voltage", "displacement")),
}
QUANTITIES = {
    "membrane": {"thickness": "0.5 mm", "permittivity": "4e-11 F/m", "prestretch": "2 1",
                 "side_length": "40 mm"},
    "tensile_strip": {"gauge_length": "50 mm", "cross_section": "10 mm^2"},
    "tubular": {"thickness": "0.08 mm", "relative_permittivity": "3 1", "active_length": "50 mm"},
}  # fmt: skip


def new(*arguments: object) -> Path:
    main(["new", "mine", "--folder", ".", *map(str, arguments)])
    return Path("mine")


def row_of(folder: Path) -> dict[str, str]:
    lines = (folder / "experiments.csv").read_text().splitlines()
    (row,) = csv.DictReader(line for line in lines if not line.startswith("#"))
    return row


def fill_in(folder: Path, unit_of: dict[str, str]) -> None:
    """Do what a user does: quantities, units that no file states, and no more marks."""
    path = folder / "specimen.yaml"
    content = yaml.safe_load(path.read_text().replace("?", ""))
    stated = {n: t.split() for n, t in QUANTITIES[content["system"]].items()}
    content["quantities"] = {n: {"value": float(v), "unit": u} for n, (v, u) in stated.items()}
    content["provenance"] = {"kind": "measured"}
    path.write_text(yaml.safe_dump(content))
    table = (folder / "experiments.csv").read_text()
    for channel, unit in unit_of.items():
        table = table.replace(f"{channel} [?]", f"{channel} [{unit}]")
    (folder / "experiments.csv").write_text(table.replace("?", ""))


@pytest.mark.parametrize("name", CASES)
def test_from_files_to_a_clean_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write, system, protocol, channels = CASES[name]
    source = write(tmp_path / name)
    folder = new(*(["--system", system] if system else []), "--from", source)
    assert "deabayes check mine" in capsys.readouterr().out
    row = row_of(folder)
    assert (row["protocol"], row["role"]) == (protocol, "calibrate?")
    assert (row["excitation"], row["response"]) == channels
    assert (folder / row["record"]).read_bytes() == source.read_bytes()
    faults = check_folder(folder).faults
    guessed = [fault for fault in faults if "guessed" in fault]
    assert any(f"protocol {protocol[:-1]}, role calibrate" in fault for fault in guessed)
    assert any("guessed system: tensile_strip" in fault for fault in guessed) == (system is None)
    fill_in(folder, {"time": "s", "voltage": "kV", "displacement": "mm"})
    report = check_folder(folder)
    assert report.faults == []
    record = report.read.record(report.read.table[0])  # type: ignore[union-attr]
    np.testing.assert_allclose(record.columns["time"], TIME, atol=1e-5)
    largest = {"voltage": 3e3, "displacement": 0.04 if name == "hold.xlsx" else 0.03}[channels[0]]
    assert record.columns[channels[0]].max() == pytest.approx(largest, rel=1e-3)


def test_what_no_file_states_is_left_to_fill_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = new("--system", "tubular", "--from", mat(tmp_path / "run.mat"))
    wanted = "run.t = time [?]; run.U = voltage [?]; run.x = displacement [?]"
    assert row_of(folder)["columns"] == wanted
    faults = "\n".join(check_folder(folder).faults)
    assert "column voltage: write its unit in place of the question mark, such as" in faults


@pytest.mark.parametrize(
    ("excitation", "protocol"),
    [(SINE_KV, "sine?"), (SWEEP_KV, "sweep?"), (STEP_KV, "creep?"), (np.ones(240), "creep?")],
)
def test_protocols_of_a_voltage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, excitation: np.ndarray, protocol: str
) -> None:
    monkeypatch.chdir(tmp_path)
    head = ["time [s];voltage [kV];strain [%];current [mA]"]
    columns = TIME, excitation, noisy(excitation), noisy(excitation)
    folder = new("--system", "tubular", "--from", text_file(head, *columns)(tmp_path / "a.csv"))
    row = row_of(folder)
    assert (row["protocol"], row["response"], row["columns"]) == (protocol, "strain?", "")


@pytest.mark.parametrize(
    ("head", "system", "protocol", "more"),
    [
        ("f / Hz;Gain;Phase (deg)", "tubular", "frequency_response", {"bias_kV": "?"}),
        (
            "Weg (mm);Kraft (N);Probe (1)",
            "minimum_energy_structure",
            "quasi_static",
            {"voltage_kV": "?"},
        ),
        ("Dehnung (%);Stress (MPa);Nr.", "tensile_strip", "quasi_static", {}),
    ],
)
def test_records_without_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, head: str, system: str, protocol: str,
    more: dict[str, str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    values = np.linspace(1.0, 2.0, 20)
    path = text_file([head], values, 1.0 / values, -values)(tmp_path / "a.csv")
    row = row_of(new("--system", system, "--from", path))
    assert row["protocol"] == protocol
    assert {key: row[key] for key in more} == more


@pytest.mark.parametrize(
    ("stress", "values", "response"),
    [
        ("Stress (kPa)", np.full(TIME.size, np.nan), "force"),
        ("Stress (KPa)", HOLD_MM, "force?"),
        ("Stress (kPa)", HOLD_MM, "nominal_stress?"),
    ],
    ids=["no value", "no known unit", "both"],
)
def test_which_response_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stress: str, values: np.ndarray, response: str
) -> None:
    monkeypatch.chdir(tmp_path)
    head = [f"Time (s);{stress};Position (mm);Load (N)"]
    path = text_file(head, TIME, values, HOLD_MM, noisy(HOLD_MM))(tmp_path / "a.csv")
    assert row_of(new("--from", path))["response"] == response


def test_several_files_in_one_encoding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    head = ["Zeit (s);Weg (µm);Kraft (N)"]
    paths = [
        text_file(head, TIME, 1e3 * moved, noisy(moved), encoding="cp1252")(tmp_path / name)
        for name, moved in {"Zug 1.csv": HOLD_MM, "Zug#1.csv": PULL_MM}.items()
    ]
    folder = new("--from", *paths)
    table = (folder / "experiments.csv").read_text()
    assert "Zug_1,relaxation?,records/Zug_1.csv,calibrate?" in table
    assert "Zug_1_2,load_unload?,records/Zug_1_2.csv,validate?" in table
    with pytest.raises(UserError, match=r"record_format\.encoding: cp1252; correct what is wrong"):
        read_folder(folder)
    with pytest.raises(UserError, match="guessed system: tensile_strip, record_format"):
        read_specimen(folder)
    fill_in(folder, {})
    assert read_specimen(folder).system == "tensile_strip"
    assert check_folder(folder).faults == []


def test_the_same_guess_of_several_rows_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = [
        text_file(["Zeit (s);Weg (mm);Kraft (N)"], TIME, HOLD_MM, noisy(HOLD_MM, i))(
            tmp_path / f"{i}.csv"
        )
        for i in range(3)
    ]
    faults = [f for f in check_folder(new("--from", *paths)).faults if "experiments.csv, line" in f]
    assert [re.search(r"lines? [\d, ]+", fault)[0] for fault in faults] == ["lines 3, 4", "line 5"]  # type: ignore[index]


MISTAKES: dict[str, tuple[list[str], str]] = {
    "no system": (
        ["a.csv"],
        "the columns suit membrane, minimum_energy_structure, tubular; say wh",
    ),
    "another system": (
        ["a.csv", "--system", "tensile_strip"],
        "no column can be what drives a tensi",
    ),
    "unknown system": (["a.csv", "--system", "tube"], "unknown system 'tube'"),
    "no file": (["gone.csv"], "gone.csv: there is no such file; name files behind --from"),
    "folder": (["."], ".: is a folder; name files behind --from"),
    "empty": (["empty.csv"], "empty.csv: the file is empty"),
    "PDF": (["a.pdf"], "a.pdf: is not a text file but looks like a PDF"),
    "old Excel": (["a.xls"], "a.xls: old Excel files cannot be read"),
    "no header": (["bare.csv"], "bare.csv: starts with numbers"),
    "files that differ": (["a.csv", "b.csv"], "a.csv and 1 more: no system has all their columns"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_leave_nothing_behind(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    mistake: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    text_file(["time [s];voltage [kV];displacement [mm]"], TIME, STEP_KV, STEP_MM)(Path("a.csv"))
    text_file(["time [s];stretch [1];force [N]"], TIME, 1.0 + STEP_MM, STEP_MM)(Path("b.csv"))
    text_file([], TIME, STEP_KV, STEP_MM)(Path("bare.csv"))
    Path("empty.csv").write_text("")
    Path("a.pdf").write_bytes(b"%PDF-1.4")
    Path("a.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    arguments, said = MISTAKES[mistake]
    with pytest.raises(SystemExit) as left:
        new("--from", *arguments)
    assert left.value.code == 1
    assert said in capsys.readouterr().err
    assert not Path("mine").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["mine"], "give --system, or the files of its records: --from FILE..."),
        (["mine", "a.csv"], "a.csv: write --from before the first file"),
        (["a.csv", "--from", "b.csv"], "the study's name comes first: NAME --from FILE..."),
    ],
)
def test_wrong_use_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("x")
    with pytest.raises(SystemExit) as left:
        main(["new", *arguments])
    assert left.value.code == 2
    assert said in capsys.readouterr().err
