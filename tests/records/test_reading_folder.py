"""What is read of a study folder: its table, its records, where they lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.study_folders import (
    faults_of,
    make_folder,
    record_lines,
    replace_in,
    write_lines,
)

from deabayes.faults import Faults, Report, UserError
from deabayes.records.folder import read_folder, scan_folder
from deabayes.records.table import scan_table


def test_a_sound_folder(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    read = read_folder(folder)
    assert [r.name for r in read.table] == ["relax", "pull"]
    assert read.table[0].metadata == {"note": "first"}
    assert read.table[1].metadata == {"stretch_rate_per_s": 0.25}
    raw = read.record(read.table[0])
    assert raw.columns["displacement"].max() == pytest.approx(0.06)
    assert read.locate(read.table[0]) == folder / "records" / "relax.csv"
    assert read.warnings(read.table[0]) == []
    assert read.specimen.name == "strip A"


def test_cells_of_several_lines(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "first", '"first\n# two\x0c\u2028 \n\nlines"')
    rows = read_folder(folder).table
    assert rows[0].metadata["note"] == "first\n# two\x0c\u2028 \n\nlines"
    replace_in(folder / "experiments.csv", "validate", "valid")
    with pytest.raises(Faults, match="line 6, role"):
        read_folder(folder)


@pytest.mark.parametrize(
    ("system", "written", "meant"),
    [
        ("tubular", "load_kg", "load_g"),
        ("tubular", "load", "load_g"),
        ("tubular", "amplitude_V", "amplitude_kV"),
        ("minimum_energy_structure", "voltage_V", "voltage_kV"),
        ("tensile_strip", "load_kg", None),
        ("tensile_strip", "amplitude_mm", None),
        ("tensile_strip", "deformation_rate", None),
        ("membrane", "load", None),
    ],
)
def test_only_columns_that_the_system_reads_can_be_misspelt(
    tmp_path: Path, system: str, written: str, meant: str | None
) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "stretch_rate_per_s", written)
    report = Report()
    scan_table(folder, report, system)
    found = [fault for fault in report.faults if "no model reads" in fault]
    assert bool(found) == (meant is not None)
    assert meant is None or f"column {written!r}; did you mean {meant!r}?" in found[0]


@pytest.mark.parametrize("known", [True, False])
def test_a_pull_on_an_actuator_needs_its_voltage(
    tmp_path: Path, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deabayes.records import checks

    channels = ({"voltage": "V", "displacement": "m"}, {"force": "N"})
    monkeypatch.setattr(checks, "channels_of", lambda system, protocol: channels)
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "relaxation", "quasi_static")
    if known:
        replace_in(folder / "experiments.csv", "stretch_rate_per_s", "voltage_kV")
        replace_in(folder / "experiments.csv", "first,", "first,4")
    faults = faults_of(folder)
    assert [f for f in faults if "voltage during the pull is not known" in f] == faults
    assert len(faults) == (0 if known else 1)


def test_missing_folder(tmp_path: Path) -> None:
    assert "no such folder" in faults_of(tmp_path / "gone")[0]


def test_table_in_another_dialect(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    path = folder / "experiments.csv"
    text = path.read_text().replace(",", ";")
    path.write_text(f"# made by hand\n\n{text}\n;;;;;;;\n", encoding="utf-8-sig")
    assert [r.name for r in read_folder(folder).table] == ["relax", "pull"]


def test_matlab_record_with_columns_in_the_table(tmp_path: Path) -> None:
    import scipy.io

    folder = make_folder(tmp_path)
    rows = np.array([line.split(",") for line in record_lines(1)[1:]], dtype=float)
    variables = dict(zip(("t", "displacement", "F"), rows.T, strict=True))
    scipy.io.savemat(folder / "records" / "relax.mat", variables)
    columns = "t = time [s]; displacement [mm]; F = force [N]"
    replace_in(folder / "experiments.csv", "relax.csv", "relax.mat")
    replace_in(folder / "experiments.csv", "note,", "columns,")
    replace_in(folder / "experiments.csv", "first", columns)
    read = read_folder(folder)
    assert read.record(read.table[0]).columns["force"].size == 40


def test_voltage_on_from_the_first_sample_is_a_step_not_a_fault(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    (folder / "specimen.yaml").write_text(
        "name: tube\nsystem: tubular\nprovenance: {kind: measured}\nquantities:\n"
        "  thickness: {value: 80, unit: µm}\n  relative_permittivity: {value: 3.1, unit: 1}\n",
        encoding="utf-8",
    )
    line = "{n},creep,records/{n}.csv,{r},voltage,strain"
    rows = [line.format(n="a", r="calibrate"), line.format(n="b", r="validate")]
    head = "name,protocol,record,role,excitation,response"
    write_lines(folder / "experiments.csv", [head, *rows])
    for name, volts in (("a", 2.5), ("b", 0.0)):
        lines = [f"{0.1 * i:.1f},{volts},{i + volts}" for i in range(9)]
        header_line = "time [s],voltage [kV],strain [%]"
        write_lines(folder / "records" / f"{name}.csv", [header_line, *lines])
    report = Report()
    read, faults = scan_folder(folder, report), report.faults
    assert read is not None
    assert len(faults) == 1
    assert "(b), column voltage: is constant" in faults[0]
    assert any("first sample" in w for w in read.warnings(read.table[0]))


def test_a_record_unlike_any_file_is_not_guessed(tmp_path: Path) -> None:
    """Their ending, `.csv`, is no likeness."""
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "relax.csv", "zzz.csv")
    with pytest.raises(UserError) as caught:
        read_folder(folder)
    assert "zzz.csv" in str(caught.value) and "did you mean" not in str(caught.value)


def test_of_files_that_differ_in_their_ending_the_written_one_is_meant(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    for ending in ("bak", "txt"):
        (folder / "records" / f"relax.{ending}").write_text("")
    replace_in(folder / "experiments.csv", "relax.csv", "relx.csv")
    with pytest.raises(UserError, match=r"did you mean 'records/relax\.csv'\?"):
        read_folder(folder)
