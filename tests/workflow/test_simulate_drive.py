"""`deabayes simulate` from a record that cannot drive: file, row and remedy in one message."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder

from deabayes.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
TUBE = ("tubular", "voigt_kelvin_1", "--specimen", str(ROOT / "data" / "tubular"))
TUBE_VALUES = ("E_0=1.5e6", "E_1=6e6", "tau_1=0.1")
STRIP = ("tensile_strip", "neo_hookean", "--specimen", "strip")


RAMP = "time [s],voltage [kV]\n0,1\n1,2\n2,3\n"


def simulate(
    place: Path,
    record: str,
    system: tuple[str, ...],
    values: tuple[str, ...],
    output: str = "out.csv",
) -> None:
    (place / "drive.csv").write_text(record)
    settings = [word for value in values for word in ("--set", value)]
    main(["simulate", *system, "--excitation", "drive.csv", *settings, "-o", output])


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ("Zeit [s],voltage [kV]\n0,1\n1,2\n2,3\n", "'Zeit' is a time .* call it 'time .s.'"),
        ("t [ms],voltage [kV]\n0,1\n1,2\n2,3\n", "'t' is a time"),
        ("tiem,voltage [kV]\n0,1\n1,2\n2,3\n", "column 'time' is missing, and voltage drives"),
        ("time [s],voltage [kV]\n0,1\n2,2\n1,3\n", "column time: goes back at data row 3"),
        ("time [s],voltage [kV]\n0,1\n1,2\n1,3\n", "column time: data row 3 repeats"),
        ("time [s],voltage [kV]\n0,1\n1,nan\n2,3\n", "column voltage: .* first in data row 2"),
        ("time [s],voltage [kV]\n0,1\n,2\n2,3\n", "column time: .* first in data row 2"),
    ],
)
def test_a_drive_in_time(
    place: Path, capsys: pytest.CaptureFixture[str], record: str, words: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        simulate(place, record, TUBE, TUBE_VALUES)
    said = capsys.readouterr().err
    assert (
        ended.value.code == 1 and said.startswith("deabayes: drive.csv") and said.count("\n") == 1
    )

    assert re.search(words, said), said
    assert "specimen.yaml" not in said
    assert not (place / "out.csv").exists()


def test_a_drive_without_time_ascends(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate(place, "stretch [1],note\n1,a\n1.5,b\n2,c\n", STRIP, ("mu=3e4",))
    assert (place / "out.csv").read_text().startswith("stretch [1],nominal_stress [Pa]")
    with pytest.raises(SystemExit):
        simulate(place, "stretch [1],note\n1,a\n2,b\n1.5,c\n", STRIP, ("mu=3e4",))
    said = capsys.readouterr().err
    assert "drive.csv, column stretch: does not ascend at data row 3" in said
    assert said.rstrip().endswith("or add a column 'time [s]'")


@pytest.mark.parametrize(
    ("drive", "advice"),
    [
        ("time [s],displacement [mm]\n0,0\n1,1\n2,0\n", "remove the column 'time', and sort"),
        ("displacement [mm]\n0\n1\n0\n", "and there is no time; sort the rows\n"),
    ],
)
def test_a_pull_of_a_structure_is_at_no_time(
    place: Path, capsys: pytest.CaptureFixture[str], drive: str, advice: str
) -> None:
    folder = str(ROOT / "data" / "minimum_energy_structure")
    structure = ("minimum_energy_structure", "ogden_1", "--specimen", folder)
    with pytest.raises(SystemExit):
        simulate(place, drive, structure, ("mu_1=3e4", "alpha_1=2"))
    said = capsys.readouterr().err
    assert "drive.csv" in said and advice in said and "add a column" not in said


def test_a_parameter_outside_its_support_is_named(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        simulate(place, "time [s],voltage [kV]\n0,1\n1,2\n", TUBE, ("E_0=-1.5e6", *TUBE_VALUES[1:]))
    assert ended.value.code == 1
    assert "parameter E_0 is -1.5e+06 Pa; it must be" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("values", "output", "words"),
    [
        ((*TUBE_VALUES, "E_0=2e6"), "out.csv", "--set: E_0 is given twice; keep one"),
        (TUBE_VALUES, "out.xlsx", "-o out.xlsx: the command writes a CSV table; name it .csv"),
    ],
)
def test_what_would_be_passed_over(
    place: Path,
    capsys: pytest.CaptureFixture[str],
    values: tuple[str, ...],
    output: str,
    words: str,
) -> None:
    with pytest.raises(SystemExit) as ended:
        simulate(place, RAMP, TUBE, values, output)
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"deabayes: {words}\n"
    assert not (place / output).exists()
