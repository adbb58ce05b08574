"""What an earlier run left behind is no part of a later one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.posteriors.test_predict_with import STUDY, creep, file
from tests.shared.fake_results import write_study as write_results
from tests.shared.study_folders import make_folder

from deabayes.cli.main import main
from deabayes.faults import UserError
from deabayes.figures.results import StudyResults
from deabayes.pipeline import predict_candidate, prepare_study
from deabayes.pipeline.prepare import calibrated_files
from deabayes.posteriors.storage import write_tree
from deabayes.records.preparation.prepared import write_prepared
from deabayes.report.tables import write_csv
from deabayes.studies import write_study
from deabayes.study import Study


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def strip(tmp_path: Path) -> Study:
    return Study("strip", make_folder(tmp_path), ("kv_gm_1",))


def test_records_that_a_study_no_longer_has_are_not_prepared(strip: Study, tmp_path: Path) -> None:
    prepared = tmp_path / "prepared"
    prepare_study(strip, prepared)
    assert names(prepared) == ["pull.nc", "relax.nc"]
    (prepared / "mine.nc").write_text("a file of the user's")
    write_tree(file(None), prepared / "posterior.nc")
    prepare_study(replace(strip, validate=()), prepared)
    assert names(prepared) == ["mine.nc", "posterior.nc", "relax.nc"]


def test_a_fault_in_one_record_leaves_the_prepared_ones(strip: Study, tmp_path: Path) -> None:
    prepared = tmp_path / "prepared"
    prepare_study(strip, prepared)
    before = {path.name: path.read_bytes() for path in prepared.iterdir()}
    nothing_left = {"relaxation": [], "load_unload": [{"crop": {"from": "1000 s"}}]}
    with pytest.raises(UserError, match="pull"):
        prepare_study(replace(strip, preparation=nothing_left), prepared)
    assert {path.name: path.read_bytes() for path in prepared.iterdir()} == before


def test_a_record_prepared_alone_is_the_same_as_with_its_study(
    strip: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Faults of other records do not matter."""
    prepare_study(strip, tmp_path / "prepared")
    write_study(strip, tmp_path / "study.yaml")
    (strip.specimen / "records" / "relax.csv").unlink()
    command = ("prepare", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "alone"), "--record")
    main([*command, "pull"])
    assert names(tmp_path / "alone") == ["pull.nc"]
    assert (tmp_path / "alone/pull.nc").read_bytes() == (tmp_path / "prepared/pull.nc").read_bytes()
    for name, said in (
        ("pul", "study strip has no record 'pul'; did you mean"),
        ("relax", "relax.csv"),
    ):
        with pytest.raises(SystemExit):
            main([*command, name])
        assert said in capsys.readouterr().err


def test_a_listed_record_is_fitted_even_if_others_are_at_hand(strip: Study, tmp_path: Path) -> None:
    prepare_study(strip, tmp_path)
    listed = replace(strip, calibrate=("relax",))
    assert calibrated_files(strip, tmp_path) == [tmp_path / "relax.nc"]
    (tmp_path / "pull.nc").write_text("another job writes it")
    assert calibrated_files(listed, tmp_path) == [tmp_path / "relax.nc"]
    prepare_study(strip, tmp_path / "again")
    with pytest.raises(UserError, match="was prepared with the role validate, but study strip"):
        calibrated_files(replace(strip, calibrate=("pull",)), tmp_path / "again")


def test_records_that_a_study_no_longer_has_are_not_predicted(tmp_path: Path) -> None:
    posterior, prepared = tmp_path / "posterior.nc", tmp_path / "prepared"
    write_tree(file(None, replace(STUDY, predict_with={})), posterior)
    write_prepared(creep(), prepared / "creep.nc")
    write_prepared(replace(creep(), name="other", role="validate"), prepared / "other.nc")
    to = tmp_path / "predictions", tmp_path / "errors.csv"
    predict_candidate(posterior, prepared, *to)
    assert names(to[0]) == ["creep.nc", "other.nc"]
    (prepared / "other.nc").unlink()
    predict_candidate(posterior, prepared, *to)
    assert names(to[0]) == ["creep.nc"]


def test_a_candidate_that_a_study_no_longer_has_is_not_shown(tmp_path: Path) -> None:
    results = write_results(tmp_path)
    fitted = [c.name for c in StudyResults(results).candidates]
    assert len(fitted) > 1
    write_study(Study(results.name, Path("strip"), tuple(fitted[1:])), results / "study.yaml")
    assert [c.name for c in StudyResults(results).candidates] == fitted[1:]
    write_csv([StudyResults(results)], tmp_path / "tables")
    table = (tmp_path / "tables" / f"{results.name}_summary.csv").read_text()
    assert fitted[1] in table and f"{fitted[0]}," not in table


def test_a_candidate_that_a_study_no_longer_has_is_not_predicted_with(tmp_path: Path) -> None:
    study = replace(STUDY, name="creep", predict_with={}, candidates=("voigt_kelvin_2", "other"))
    results = tmp_path / "creep"
    for name in study.candidates:
        write_tree(file(None, study), results / name / "posterior.nc")
    write_prepared(creep(), results / "prepared" / "creep.nc")
    write_study(replace(study, candidates=("voigt_kelvin_2",)), results / "study.yaml")
    main(["predict", "creep", "--results", str(tmp_path)])
    assert names(results) == ["other", "prepared", "study.yaml", "voigt_kelvin_2"]
    assert names(results / "other") == ["posterior.nc"]
