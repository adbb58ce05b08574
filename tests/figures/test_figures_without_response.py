"""Figures of much or of nothing: many noise groups, records that no draw could follow, failures."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.text import Text
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.faults import UserError
from deabayes.figures import residuals, style
from deabayes.figures.record import Record
from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.papers.membrane import prior_curves

NOTHING = "no draw has a response"
FEW = Fake(candidates=(1, 2), protocols=("relaxation", "creep"))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return write_study(tmp_path, FEW)


def words(figure: object) -> list[str]:
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]  # type: ignore[attr-defined]


def lose(results: CandidateResults, name: str, **changed: object) -> None:
    """Every draw of a record fails."""
    prediction = results.predictions[name].copy()
    for each in ("mean", "median", *style.BANDS):
        prediction[each] = np.nan * prediction[each]
    results.predictions[name] = prediction.assign_attrs(**changed)  # type: ignore[index]


def test_colours_of_noise_groups_come_round_again(study: Path) -> None:
    results = StudyResults(study).recommended
    prediction = next(iter(results.predictions.values()))
    many = [Record(prediction.assign_attrs(experiment=f"record_{k:02}")) for k in range(40)]
    figure = residuals._spread(SimpleNamespace(noise_group=lambda name: name), many)
    boxes = [each for each in figure.axes[0].patches if isinstance(each, PathPatch)]
    shown = [to_hex(each.get_facecolor()) for each in boxes]
    assert len(shown) == 40
    assert shown[:8] == [colour.lower() for colour in style.SERIES] == shown[32:]


def test_residuals_of_a_record_without_response_say_so(study: Path) -> None:
    results = StudyResults(study).recommended
    name = next(n for n in results.predictions if n.startswith("relaxation"))
    assert Record(results.predictions[name]).against_coordinate().logarithmic
    lose(results, name)
    along, spread = figures.draw("residuals", results)
    assert words(along).count(NOTHING) == words(spread).count(NOTHING) == 1


def test_data_of_a_record_without_response_are_shown_and_said_to_have_none(study: Path) -> None:
    results = StudyResults(study).recommended
    name = next(n for n in results.predictions if n.startswith("relaxation"))
    lose(results, name, response_name="gain", response_unit="1")
    (figure,) = figures.draw("data_and_bands", results)
    assert words(figure).count(NOTHING) == 1


def test_errors_of_a_record_without_response_are_not_silently_blank(study: Path) -> None:
    path = study / "kv_gm_1" / "errors.csv"
    table = pd.read_csv(path)
    table.loc[0, ["e_rms_percent", "e_rms_q05", "e_rms_q95"]] = np.nan
    table.to_csv(path, index=False)
    (figure,) = figures.draw("errors", StudyResults(study))
    assert [w for w in words(figure) if NOTHING in w] == [f"kv_gm_1: {NOTHING}"]


def of_prior(candidate: str, failed: bool) -> xr.Dataset:
    time = np.linspace(0.0, 10.0, 30)
    curve = np.full((4, 30), np.nan) if failed else np.linspace(1.0, 2.0, 4)[:, None] + 0 * time
    return xr.Dataset(
        {
            "band": (("quantile", "coordinate"), curve), "curve": (("draw", "coordinate"), curve),
            "observed": ("time_", 1.5 + 0 * time), "time": ("time_", time),
            "excitation": ("coordinate", 1e3 + 0 * time),
            "failed": ("all", np.full(8, failed)),
        },
        {"coordinate": time},
        {
            "candidate": candidate, "experiment": "step", "onset": 0.0, "held": 1,
            "response_name": "displacement", "response_unit": "m",
            "excitation_name": "voltage", "excitation_unit": "V",
        },
    )  # fmt: skip


@pytest.mark.parametrize("failed", [(True, False), (False, True), (True, True)])
def test_prior_curves_of_a_candidate_whose_draws_all_fail(failed: tuple[bool, bool]) -> None:
    figure = prior_curves._sheet([of_prior(f"kv_gm_{k}", each) for k, each in enumerate(failed)])
    assert sum("100 % of 8" in word for word in words(figure)) == sum(failed)
    limits = [ax.get_ylim() for ax in figure.axes]
    assert limits[0] == limits[1] and np.isfinite(limits).all()
    assert all(failed) or (limits[0][0] < 1.0 and limits[0][1] >= 2.0)


def test_one_figure_that_fails_does_not_lose_the_others(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {name: figures.REGISTRY[name] for name in ("residuals", "coverage", "errors")}
    monkeypatch.setattr(figures, "REGISTRY", few)

    def fail(results: CandidateResults) -> None:
        raise KeyError(results.name)

    monkeypatch.setattr(residuals, "draw", fail)
    out = study / "figures"
    with pytest.raises(ExceptionGroup, match="residuals of kv_gm_1, residuals of kv_gm_2") as found:
        figures.save_all(study, out)
    assert [type(each) for each in found.value.exceptions] == [KeyError, KeyError]
    assert {path.name for path in out.glob("*.png")} == {
        "errors.png", "kv_gm_2_coverage.png"
    }  # fmt: skip
    assert figures.saved_figures(study, out) is None


def test_a_folder_that_a_run_removes_is_said(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "figures"
    monkeypatch.setattr(figures, "_drawn", lambda *_: out.rmdir() or [Figure()])
    with pytest.raises(UserError, match=r"figures: was removed while .* wait for its end"):
        figures.save_all(study, out)
