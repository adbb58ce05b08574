"""A preview of a study: its files, its marks, and what it says not to trust."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
import yaml
from tests.workflow.creep_study import write_creep_study

from deabayes.cli.main import main
from deabayes.figures import style
from deabayes.pipeline.preview import MARK, ROUGH, doubts
from deabayes.sampling.laplace import Laplace

ROOT = Path(__file__).parents[2]
CONFIG = """
studies:
  creep:
    specimen: creep
    candidates: [voigt_kelvin_1, voigt_kelvin_2]
    preparation:
      creep:
        - delay: {}
        - baseline: {}
        - mask_before: {time: 6 ms, from_step: true}
        - excitation_knots: {tolerance: 2 V}
        - average: {grid: geometric, first_width: 4 ms, ratio: 1.2, widest: 20 ms}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("preview")
    write_creep_study(ROOT / "data" / "tubular", place / "creep")
    (place / "config.yaml").write_text(CONFIG)
    return place


@pytest.fixture(scope="module")
def said(place: Path) -> str:
    """What the command prints."""
    out, marks = io.StringIO(), []
    with (
        contextlib.chdir(place),
        contextlib.redirect_stdout(out),
        patch.object(style, "watermark", lambda _, words: marks.append(words)),
    ):
        main(["fit", "creep", "--preview"])
    assert marks == ["PREVIEW", "PREVIEW"], "a figure per candidate"
    return out.getvalue()


@pytest.fixture
def folder(place: Path, said: str) -> Path:
    return place / "results" / "creep" / "preview"


def test_every_file_of_every_candidate_is_marked(folder: Path) -> None:
    for name in ("summary", "errors"):
        table = pd.read_csv(folder / f"{name}.csv")
        assert set(table["candidate"]) == {"voigt_kelvin_1", "voigt_kelvin_2"}
        assert set(table["status"]) == {MARK}
    entries = json.loads((folder / "index.json").read_text())
    assert {entry["status"] for entry in entries} == {MARK}
    for name in ("voigt_kelvin_1", "voigt_kelvin_2"):
        assert (folder / f"{name}.png").is_file() and (folder / f"{name}.svg").is_file()


def test_the_best_fit_is_near_the_truth_and_within_its_interval(folder: Path) -> None:
    truth = yaml.safe_load((ROOT / "data/tubular/truth.yaml").read_text())["parameters"]
    table = pd.read_csv(folder / "summary.csv").set_index(["candidate", "parameter"])
    row = table.loc["voigt_kelvin_2", "tau_2"]
    assert row["unit"] == "s" and row["kind"] == "material"
    assert row["estimate"] == pytest.approx(truth["tau_2"], rel=0.3)
    thickness = table.loc["voigt_kelvin_2", "thickness"]
    assert thickness["kind"] == "specimen"
    sampled = table[table["kind"] != "derived"]
    assert (sampled["q05"] < sampled["q95"]).all()
    within = (sampled["q05"] <= sampled["estimate"]) & (sampled["estimate"] <= sampled["q95"])
    assert within.mean() > 0.8


def test_errors_are_those_of_the_best_fit(folder: Path) -> None:
    errors = pd.read_csv(folder / "errors.csv")
    assert set(errors["role"]) == {"calibrate", "validate"}
    by_candidate = errors.groupby("candidate")["e_rms_percent"].max()
    assert 0.1 < by_candidate["voigt_kelvin_2"] < 3.0
    assert len(errors) == 6


def test_the_screen_has_estimates_with_units_and_errors(said: str) -> None:
    assert said.startswith("PREVIEW of study creep: best fits, not sampled.")
    assert "sampled ones may be several times wider" in said.splitlines()[1]
    assert "voigt_kelvin_2: estimate (5 % to 95 %)" in said
    assert "largest errors (e_rms): creep_" in said
    assert any(line.strip().startswith("thickness") and "µm" in line for line in said.splitlines())
    assert "creep.sigma_white" not in said, "noise is in the table"


def test_an_own_folder_is_not_deleted(place: Path, said: str) -> None:
    with contextlib.chdir(place), pytest.raises(SystemExit):
        main(["fit", "creep", "--preview", "--prepared", "results/creep/prepared", "-o", "creep"])
    assert (place / "creep" / "specimen.yaml").is_file()


@pytest.mark.parametrize(
    "arguments", [("fit", "creep"), ("fit", "creep", "voigt_kelvin_1", "--preview")]
)
def test_one_candidate_is_fitted_or_all_are_previewed(
    place: Path, arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with contextlib.chdir(place), pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "CANDIDATE" in capsys.readouterr().err


def test_a_study_without_any_response_is_a_sentence_and_leaves_the_last_preview(
    place: Path, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from deabayes.inference.log_posterior import LogPosterior
    from deabayes.posteriors import problem

    monkeypatch.setattr(
        problem,
        "split_log_likelihood",
        lambda target, z: problem.Split(*(np.full((len(z), n), np.nan) for n in (1, 1)),
                                        np.full(len(z), np.nan)),
    )  # fmt: skip
    monkeypatch.setattr(
        LogPosterior, "log_likelihood_of_normal", lambda self, z: np.full(len(z), -np.inf)
    )
    with contextlib.chdir(place), pytest.raises(SystemExit):
        main(["fit", "creep", "--preview", "--prepared", "results/creep/prepared"])
    assert "no start of the preview has a response" in capsys.readouterr().err
    assert (place / "results/creep/preview/summary.csv").is_file()


def laplace(**changed: object) -> Laplace:
    usual = {
        "peak": np.zeros(5), "value": 0.0, "draws": np.zeros((1, 5)), "climbs": 16, "agreed": 16,
        "next_lower": None, "not_curved": 0, "effective": 0.9,
    }  # fmt: skip
    return Laplace(**(usual | changed))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"agreed": 1, "next_lower": 3.21}, ["no other of 16 starts", "3.2 nats lower"]),
        ({"agreed": 12, "next_lower": 2.0}, ["4 of 16 starts ended at a worse fit"]),
        ({"not_curved": 2}, ["not positive definite", "2 of 5 directions"]),
        ({"effective": ROUGH / 2}, ["not normal", "rough"]),
        ({"draws": np.zeros((0, 5)), "effective": 0.0}, ["there are no intervals"]),
    ],
)
def test_each_reason_not_to_trust_is_said(changed: dict[str, object], words: list[str]) -> None:
    assert list(doubts(laplace())) == []
    (said,) = doubts(laplace(**changed))
    for word in words:
        assert word in said


def test_the_report_does_not_draw_again_for_a_newer_preview(place: Path, folder: Path) -> None:
    from deabayes.figures.results import StudyResults

    inputs = StudyResults(folder.parent).inputs
    assert any(path.parent.name == "prepared" for path in inputs)
    assert not any(path.parent.name == "preview" for path in inputs)
    assert (folder / "summary.csv").is_file()
