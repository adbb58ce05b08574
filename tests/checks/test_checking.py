"""`deabayes check` of a folder, and `deabayes new`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.shared.study_folders import (
    HEADER,
    SPECIMENS,
    make_folder,
    record_lines,
    replace_in,
    write_lines,
)

from deabayes.checks.folder import check_folder
from deabayes.faults import UserError
from deabayes.records.scaffold import new_study
from deabayes.systems import REGISTRY

REAL_DATA = Path(os.environ.get("DEABAYES_DATA", Path(__file__).parents[3] / "shared" / "data"))


def test_report_says_what_was_understood(tmp_path: Path) -> None:
    report = check_folder(make_folder(tmp_path))
    assert report.ok
    text = report.text()
    for words in (
        "strip A: tensile_strip, measured",
        "gauge_length = 80 mm (exact)",
        "cross_section = 22 ± 1.1 mm² (a parameter)",
        "instrument force.noise = 1 mN",
        "relax: relaxation, calibrate, displacement -> force",
        "40 rows, 3.9 s, sampled at 10 Hz",
        "displacement from 0 to 60 mm",
        "stretch_rate_per_s 0.25",
        "0 faults, 0 warnings",
    ):
        assert words in text


def test_a_plain_number_has_no_unit_behind_it(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    rows = [f"{i / 10},{1 + i / 20},{i * i}" for i in range(41)]
    write_lines(folder / "records" / "relax.csv", ["time [s],stretch [1],force [mN]", *rows])
    text = (folder / "experiments.csv").read_text()
    head, relax = text.splitlines()[0], next(r for r in text.splitlines() if "relax.csv" in r)
    write_lines(folder / "experiments.csv", [head, relax.replace("displacement", "stretch")])
    assert "stretch from 1 to 3\n" in check_folder(folder).text()


def test_small_and_large_values_are_shown_with_a_prefix(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "value: 80, unit: mm", "value: 80, unit: um")
    replace_in(folder / "specimen.yaml", "sd: 1.1", "sd: 254")
    text = check_folder(folder).text()
    assert "gauge_length = 80 µm (exact)" in text
    assert "± 250 mm² (a parameter)" in text


def test_report_holds_every_fault_and_still_shows_the_rest(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "gauge_length", "gage_length")
    write_lines(folder / "records" / "relax.csv", record_lines(1, rows=2))
    replace_in(folder / "records" / "pull.csv", "\n1.0000,", "\n1.0500,")
    report = check_folder(folder)
    assert not report.ok
    assert len(report.faults) == 2
    text = report.text()
    assert "relax: relaxation, calibrate, displacement -> force (cannot be used" in text
    assert "pull: load_unload" in text
    assert "gage_length" in text
    assert "gage_length" not in report.text(with_faults=False)


def test_warnings_are_shown(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "value: 10, unit: N", "value: 1.15, unit: N")
    lines = [line for i, line in enumerate(record_lines(2)) if not 20 <= i < 35]
    write_lines(folder / "records" / "pull.csv", lines)
    report = check_folder(folder)
    assert report.ok
    assert any("(relax), column force" in w and "clipped" in w for w in report.warnings)
    assert any("(pull): a gap of 1.6 s" in w for w in report.warnings)
    assert "Warnings" in report.text()


def test_amplifier_at_its_limit_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    with (folder / "specimen.yaml").open("a") as stream:
        stream.write("  current_limit: {value: 120, unit: mA}\n")
    lines = [f"{line},{120 if i < 4 else 0}" for i, line in enumerate(record_lines(1)[1:])]
    write_lines(folder / "records" / "relax.csv", [f"{HEADER},current [mA]", *lines])
    (warning,) = check_folder(folder).warnings
    assert "current limit of 120 mA in 10.00%" in warning


def test_an_sd_beyond_the_value_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    assert check_folder(folder).warnings == []
    replace_in(folder / "specimen.yaml", "sd: 1.1", "sd: 30")
    (warning,) = check_folder(folder).warnings
    assert "specimen.yaml, quantities.cross_section: its sd is 1.36 times its value" in warning


@pytest.mark.parametrize("system", REGISTRY)
def test_new_study_only_needs_filling_in(tmp_path: Path, system: str) -> None:
    entry = new_study("mine", system, tmp_path)
    said, entry = entry.split("\n", 1)
    assert said.startswith("# Add this under `studies:`")
    assert entry.startswith("  mine:\n    specimen: ")
    assert "candidates: [" in entry
    report = check_folder(tmp_path / "mine")
    left = [f for f in report.faults if "expected a number, found '...'" not in f]
    assert len(left) == 1
    assert "there is no such file" in left[0]
    with pytest.raises(UserError, match="exists already and is not overwritten"):
        new_study("mine", system, tmp_path)


def test_new_study_refuses_names_and_systems(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"'a/b' cannot be a study's name"):
        new_study("a/b", "tubular", tmp_path)
    with pytest.raises(UserError, match=r"unknown system 'tubula'; did you mean 'tubular'"):
        new_study("a", "tubula", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", sorted(p.parent.name for p in SPECIMENS.glob("*/specimen.yaml")))
def test_every_shipped_folder_is_sound(folder: str) -> None:
    from deabayes.records.download import missing_data

    path = SPECIMENS / folder
    if missing_data(path, REAL_DATA):
        pytest.skip("public data not here")
    report = check_folder(path, REAL_DATA)
    assert report.faults == []
