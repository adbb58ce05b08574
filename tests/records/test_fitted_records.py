"""A posterior is judged on the records it was fitted to, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.posteriors.test_predict_with import STUDY, creep, file

from deabayes.experiment import Experiment
from deabayes.faults import UserError
from deabayes.pipeline import (
    analyse_study,
    build_report,
    compare_candidates,
    draw_figures,
    predict_candidate,
    score_candidate,
)
from deabayes.posteriors.records import check_fitted_records
from deabayes.posteriors.storage import write_tree
from deabayes.records.preparation.prepared import write_prepared

FITTED = creep()
CHANGED = replace(FITTED, response=1.01 * FITTED.response)
HELD_OUT = replace(CHANGED, name="other", role="validate")
HIGHER = replace(FITTED, excitation=replace(FITTED.excitation, values=FITTED.excitation.values + 1))
STAGES: dict[str, Callable[[Path, Path, Path], object]] = {
    "score": lambda posterior, prepared, to: score_candidate(posterior, prepared, to / "s.json"),
    "compare": lambda posterior, prepared, to: compare_candidates(
        [posterior], prepared, to / "comparison.csv"
    ),
    "predict": lambda posterior, prepared, to: predict_candidate(
        posterior, prepared, to / "predictions", to / "errors.csv"
    ),
}
SHOWN: dict[str, Callable[[Path, Path], object]] = {
    "figures": draw_figures,
    "analyse": analyse_study,
    "report": lambda results, to: build_report([results], to / "index.html", to / "tables", ()),
}


def said(*experiments: Experiment) -> str:
    with pytest.raises(UserError) as error:
        check_fitted_records(file(None), experiments)
    return str(error.value)


@pytest.mark.parametrize("stage", STAGES)
def test_records_changed_since_the_fit_are_refused(stage: str, tmp_path: Path) -> None:
    write_tree(file(None, replace(STUDY, predict_with={})), tmp_path / "posterior.nc")
    write_prepared(CHANGED, tmp_path / "prepared" / "creep.nc")
    with pytest.raises(UserError, match=r"since the fit, record creep has changed; fit again"):
        STAGES[stage](tmp_path / "posterior.nc", tmp_path / "prepared", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["posterior.nc", "prepared"]


@pytest.mark.parametrize("stage", SHOWN)
def test_results_are_not_shown_with_other_records(stage: str, tmp_path: Path) -> None:
    write_tree(file(None), tmp_path / "study" / "voigt_kelvin_2" / "posterior.nc")
    write_prepared(CHANGED, tmp_path / "study" / "prepared" / "creep.nc")
    with pytest.raises(UserError, match=r"since the fit, record creep has changed; fit again"):
        SHOWN[stage](tmp_path / "study", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_report_of_nothing_fitted_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    with pytest.raises(UserError, match="holds no fitted candidate"):
        SHOWN["report"](tmp_path / "study", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_each_record_is_said_with_what_became_of_it() -> None:
    assert "record creep has changed" in said(CHANGED)
    assert "record creep has changed" in said(HIGHER)
    shorter = replace(FITTED, coordinate=FITTED.coordinate[1:], response=FITTED.response[1:])
    assert "record creep has changed" in said(shorter)
    assert "record creep is no calibration record any more" in said(HELD_OUT)
    added = said(FITTED, replace(HELD_OUT, role="calibrate"))
    assert added.startswith("study creep, voigt_kelvin_2: since the fit, record other was added")
    assert "`deabayes fit creep voigt_kelvin_2`" in added and added.count("\n") == 0


def test_held_out_ones_and_rounding_are_no_matter() -> None:
    rounded = replace(FITTED, response=FITTED.response * (1 + 1e-14))
    check_fitted_records(file(None), [rounded, HELD_OUT])
