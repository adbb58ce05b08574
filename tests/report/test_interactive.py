"""Curves of the interactive figures, unpacked as the page's script unpacks them."""

from __future__ import annotations

import base64
import gzip
import json

import numpy as np
import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.report import interactive


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> CandidateResults:
    fake = Fake(candidates=(1,), protocols=("relaxation", "sine", "load_unload"))
    return StudyResults(write_study(tmp_path_factory.mktemp("results"), fake)).recommended


def unpacked(record: dict, name: str) -> np.ndarray:
    return np.cumsum(record["curves"][name]) * record["step"]


def test_curves_are_the_predictions_in_display_units(results: CandidateResults) -> None:
    records = {record["name"]: record for record in interactive.curves(results)}
    for name, prediction in results.predictions.items():
        record, size = records[name], prediction.sizes["coordinate"]
        kept, every = record["points"]
        assert every == size and kept == min(size, interactive.MOST_POINTS) == len(record["x"])
        factor = {"strain (%)": 0.01, "nominal stress (kPa)": 1e3}[record["labels"][1]]
        time = prediction["coordinate"].values
        at = [int(np.argmin(np.abs(time - x))) for x in record["x"]]
        wanted = {"observed": prediction["observed"], "median": prediction["median"]}
        for band in ("parameter", "predictive"):
            wanted[f"{band}_upper"] = prediction[band].sel(level=0.9, bound="upper")
        for curve, values in wanted.items():
            error = np.abs(unpacked(record, curve) - values.values[at] / factor)
            assert error.max() <= record["step"]
    axes = [record["axes"] for record in records.values()]
    assert axes == ["log", "linear", "linear"]


def test_a_sine_of_few_points_is_shown_whole(
    results: CandidateResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interactive, "MOST_POINTS", 2000)
    points = {r["name"]: r["points"] for r in interactive.curves(results)}
    assert points["sine_stretch_2_1"] == [1500, 1500]


def test_a_record_without_a_response_shows_its_readings(results: CandidateResults) -> None:
    name, prediction = next(iter(results.predictions.items()))
    prediction["median"].values[:] = np.nan
    record = next(r for r in interactive.curves(results) if r["name"] == name)
    assert list(record["curves"]) == ["observed"]


def test_a_value_that_is_not_finite_is_left_out() -> None:
    assert interactive._increments(np.array([2.0, np.nan, 5.0, 4.0]), 0.5) == [4, None, 6, -2]


def test_the_script_is_on_the_page_once_and_only_if_there_are_curves() -> None:
    assert interactive.payloads({}) == {}
    curves = {"curves-a": [{"axes": "log"}], "curves-b": [{"axes": "loglog"}]}
    found = {
        name: gzip.decompress(base64.b64decode(text)).decode()
        for name, text in interactive.payloads(curves).items()
    }
    assert list(found) == ["bokeh", "templates", "curves-a", "curves-b"]
    assert "Bokeh" in found["bokeh"]
    assert set(json.loads(found["templates"])) == {"log", "loglog"}
    assert json.loads(found["curves-a"]) == [{"axes": "log"}]
