"""Checkpoints are resumed only while all that the draws follow from is as it was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.posteriors.test_predict_with import creep
from tests.shared.study_folders import make_folder, replace_in

from deabayes.pipeline.fit import chain_folder
from deabayes.records.preparation.prepared import write_prepared
from deabayes.study import Study

PREPARED = Path("prepared")
STUDY = Study("strip", Path("strip"), ("kv_gm_1",), prior_from="other/posterior.nc")
FITTED = creep()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A study folder, its prepared records, the posterior that `prior_from` names."""
    make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    Path("other").mkdir()
    Path("other/posterior.nc").write_bytes(b"one posterior")
    write_prepared(FITTED, PREPARED / "creep.nc")
    write_prepared(replace(FITTED, name="held_out", role="validate"), PREPARED / "held_out.nc")


def key(study: Study = STUDY) -> Path:
    return chain_folder(study, "kv_gm_1", PREPARED, Path("results"))


def change_value() -> None:
    replace_in(Path("strip/specimen.yaml"), "value: 80", "value: 81")


def change_sd() -> None:
    replace_in(Path("strip/specimen.yaml"), "sd: 1.1", "sd: 1.2")


def change_prior() -> None:
    Path("other/posterior.nc").write_bytes(b"another posterior")


def change_record() -> None:
    write_prepared(replace(FITTED, response=1.01 * FITTED.response), PREPARED / "creep.nc")


def rename_record() -> None:
    (PREPARED / "creep.nc").rename(PREPARED / "crept.nc")  # keeps its place


@pytest.mark.parametrize(
    "edit", [change_value, change_sd, change_prior, change_record, rename_record]
)
def test_after_an_edit_sampling_starts_afresh(place: None, edit: Callable[[], None]) -> None:
    before = key()
    edit()
    assert key() != before


def test_without_an_edit_it_goes_on(place: None) -> None:
    before = key()
    write_prepared(FITTED, PREPARED / "creep.nc")
    assert key() == before


def test_held_out_records_and_other_candidates_are_no_matter(place: None) -> None:
    before = key()
    write_prepared(replace(FITTED, name="new", role="validate"), PREPARED / "new.nc")
    (PREPARED / "held_out.nc").unlink()
    assert key(replace(STUDY, candidates=("kv_gm_1", "kv_gm_2"), validate=("new",))) == before
