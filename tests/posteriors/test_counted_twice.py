"""No record counts twice: not in a posterior, and again in the prior it was fitted with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.posteriors.test_predict_with import STUDY, UNCERTAIN, creep, file
from tests.prior.test_prior_sources import faults
from tests.shared.study_folders import make_folder, replace_in

from deabayes.faults import UserError
from deabayes.pipeline.fit import build_target
from deabayes.posteriors.records import (
    ATTRIBUTE,
    CountedRecord,
    counted_records,
    refuse_counted_twice,
    to_json,
)
from deabayes.posteriors.storage import write_tree
from deabayes.records.preparation.prepared import write_prepared

FITTED = replace(creep(), record_sha256="5e1f")
OTHER = replace(FITTED, name="other", response=1.2 * FITTED.response, record_sha256="07ae")
SOURCE = "results/a/kv/posterior.nc"


@pytest.mark.parametrize(
    ("record", "same"),
    [
        (FITTED, True),
        (replace(FITTED, name="renamed"), True),
        (replace(FITTED, record_sha256="c0de"), True),  # another file, the same points
        (replace(OTHER, record_sha256="5e1f"), True),  # the same file, otherwise prepared
        (replace(OTHER, record_sha256="5e1f", response_name="current"), False),
        (OTHER, False),
        (replace(FITTED, role="validate"), False),
    ],
)
def test_a_record_is_known_by_its_file_or_its_points(record, same: bool) -> None:
    known = [CountedRecord.of("a", FITTED)]
    if not same:
        refuse_counted_twice("b", [record], known, SOURCE)
        return
    with pytest.raises(UserError, match=r"study b, prior_from: record .* in study a.* twice") as e:
        refuse_counted_twice("b", [record], known, SOURCE)
    assert ("(there creep)" in str(e.value)) == (record.name != "creep")


def test_files_list_their_records_and_older_files_have_their_points() -> None:
    tree = file(None)
    (own,) = counted_records(tree)
    assert own.is_same(CountedRecord.of("a", creep()))
    del tree.attrs[ATTRIBUTE]
    (own,) = counted_records(tree)
    assert own.is_same(CountedRecord.of("a", creep()))
    assert (own.study, own.name) == ("creep", "creep")


def test_a_fit_refuses_records_behind_its_prior(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`creep` is known by the posterior's own prior."""
    monkeypatch.setattr("deabayes.records.specimen.read_specimen", lambda _: UNCERTAIN)
    tree = file(None)
    tree.attrs[ATTRIBUTE] = to_json([CountedRecord.of("x", OTHER), CountedRecord.of("y", FITTED)])
    write_tree(tree, tmp_path / "posterior.nc")
    write_prepared(FITTED, tmp_path / "prepared" / "creep.nc")
    study = replace(STUDY, prior_from=str(tmp_path / "posterior.nc"))
    with pytest.raises(UserError, match="record creep was fitted in study y"):
        build_target(study, "voigt_kelvin_2", tmp_path / "prepared")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    make_folder(tmp_path / "tube")  # of what the helper's other study is, no matter here
    return folder


def test_check_refuses_records_behind_a_prior_of_the_config(place: Path) -> None:
    found = faults({"b": None, "c": "results/b/kv_gm_2/posterior.nc"})
    assert found.startswith("study c, prior_from: record relax was fitted in study b")
    a_from_b = {"a": "results/b/kv_gm_2/posterior.nc", "b": None}
    assert faults(a_from_b) == ""
    chain = faults(a_from_b | {"c": "results/a/kv_gm_2/posterior.nc"})
    assert chain.startswith("study c, prior_from: record relax was fitted in study b")
    replace_in(place / "experiments.csv", "relax,", "first,")
    assert "record first was fitted" in faults({"b": None, "c": "results/b/kv_gm_2/posterior.nc"})
