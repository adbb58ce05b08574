"""What a folder or a study holds that nothing can use."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.shared.study_folders import make_folder, record_lines, replace_in, write_lines

from deabayes.checks.folder import check_folder
from deabayes.checks.study import check_study
from deabayes.cli.main import main
from deabayes.figures.results import StudyResults
from deabayes.pipeline import prepare_study
from deabayes.study import Study


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("specimen.yaml", "  gauge_length: {value: 80, unit: mm, source: ruler}\n", "",
         "(relax): specimen 'strip A' lacks gauge_length, which a displacement needs"),
        ("experiments.csv", "stretch_rate_per_s\n", "deformation\n",
         "(pull): unknown deformation '0.25'"),
    ],
)  # fmt: skip
def test_a_record_that_no_candidate_predicts(
    tmp_path: Path, name: str, old: str, new: str, said: str
) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / name, old, new)
    (fault,) = check_folder(folder).faults
    assert said in fault
    assert "experiments.csv" in fault


def test_steps_that_no_record_takes_are_a_warning(tmp_path: Path) -> None:
    steps = {"sine": [{"decimate": {"every": 2}}]}
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), preparation=steps)
    report = check_study(study)
    faults, warnings = report.faults, report.warnings
    assert not faults
    assert "preparation.sine: no record of the study is of this protocol" in warnings[0]


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ({"mask_between": {"from": 200, "to": 300}},
         "step mask_between (from: 200, to: 300) hides no sample of any relaxation record, from "
         "0 to 3.9 s; correct its times or their unit, or remove it"),
        ({"mask_after": {"time": 500}}, "mask_after (time: 500) hides no sample of any relaxation"),
        ({"mask_before": {"time": "0 s"}}, "mask_before (time: 0 s) hides no sample of any relaxa"),
        ({"mask_between": {"from": 5, "to": 6, "record": "relax"}}, "no sample of relax record"),
        ({"mask_between": {"from": 5, "to": 6, "record": "late"}}, None),
        ({"mask_after": {"time": 4}}, None),  # within the longer record
    ],
)  # fmt: skip
def test_masks_that_hide_nothing_are_a_warning(
    tmp_path: Path, step: dict[str, object], said: str | None
) -> None:
    folder = make_folder(tmp_path)
    row = "late,relaxation,records/late.csv,validate,displacement,force,,\n"
    with (folder / "experiments.csv").open("a") as table:
        table.write(row)
    rows = 40 if said else 80
    write_lines(folder / "records" / "late.csv", record_lines(3, rows))
    study = Study("s", folder, ("kv_gm_1",), preparation={"relaxation": [step]})
    report = check_study(study)
    faults, warnings = report.faults, report.warnings
    assert not faults
    found = [warning for warning in warnings if "hides no sample" in warning]
    assert len(found) == (said is not None)
    assert said is None or (found[0].startswith("study s, relax: step ") and said in found[0])
    prepare_study(study, tmp_path / "s" / "prepared")
    shown = [each.warnings for each in StudyResults(tmp_path / "s").experiments.values()]
    assert sum("hides no sample" in str(each) for each in shown) == len(found)


@pytest.mark.parametrize(
    ("settings", "sound", "ends"),
    [
        ("candidates: [kv_gm_one]", True, "\n1 fault, 0 warnings in strip and study s\n"),
        ("candidates: [kv_gm_1], noise: w", True, "\n1 fault, 0 warnings in strip and study s\n"),
        ("candidates: [kv_gm_1], noise: w", False, "\n2 faults, 0 warnings in strip and study s\n"),
        ("candidates: [kv_gm_1]", False, "\n1 fault, 0 warnings in strip\n"),
    ],
)
def test_faults_of_a_study_are_counted(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    settings: str,
    sound: bool,
    ends: str,
) -> None:
    folder = make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    if not sound:
        replace_in(folder / "experiments.csv", "calibrate,", "calibrated,")
    Path("config.yaml").write_text(f"studies: {{s: {{specimen: strip, {settings}}}}}\n")
    with pytest.raises(SystemExit, match="1"):
        main(["check", "s"])
    said = capsys.readouterr().out
    assert said.endswith(ends) and said.count(" warnings in ") == 1


@pytest.mark.parametrize("both", [False, True])
def test_missing_quantities_are_said_with_the_faults_of_records(tmp_path: Path, both: bool) -> None:
    folder = make_folder(tmp_path)
    replace_in(
        folder / "specimen.yaml", "  gauge_length: {value: 80, unit: mm, source: ruler}\n", ""
    )
    for name in ("relax", "pull") if both else ("pull",):
        replace_in(folder / "records" / f"{name}.csv", "\n1.0000,", "\n1.0500,now ")
    faults = check_folder(folder).faults
    assert len(faults) == 2 + both
    assert sum("lacks gauge_length" in fault for fault in faults) == 1
    assert check_study(Study("s", folder, ("kv_gm_1",))).faults == list(faults)


def test_nothing_is_asked_of_a_specimen_with_faults(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "gauge_length", "gage_length")
    (fault,) = check_folder(folder).faults
    assert "gage_length" in fault


def test_what_is_left_to_fill_in_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "source: laboratory, licence: CC0", "licence: ...")
    replace_in(folder / "specimen.yaml", "source: ruler", "source: ...")
    licence, source = check_folder(folder).warnings
    assert "specimen.yaml, provenance.licence: is '...', as `deabayes new` writes it" in licence
    assert "specimen.yaml, quantities.gauge_length.source: is '...'" in source


def test_what_preparation_warns_of_is_shown(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "load_unload", "quasi_static")
    replace_in(folder / "records" / "pull.csv", "\n1.0000,20.0000,", "\n1.0000,16.0000,")
    assert check_folder(folder, as_study=False).warnings == []
    (warning, *_) = check_study(Study("s", folder, ("ogden_1",))).warnings
    assert warning.startswith("study s, pull: displacement goes back and forth")


def test_all_missing_quantities_are_said_at_once(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    described = yaml.safe_load((folder / "specimen.yaml").read_text())
    described["quantities"] = {}
    (folder / "specimen.yaml").write_text(yaml.safe_dump(described))
    force, displacement = check_folder(folder).faults
    assert "(relax): specimen 'strip A' lacks cross_section, which a force needs" in force
    assert "lacks gauge_length, which a displacement needs" in displacement
