"""The analysis `influence` and its figures, on a made-up membrane study."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.contexts import CANDIDATES, context
from tests.unit.fake_results import Fake, write_study

from deabayes import analyses, figures
from deabayes.analyses import influence
from deabayes.figures.results import StudyResults

FIGURES = ("prior_curves", "one_at_a_time", "sobol_indices")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    fake = Fake(candidates=(1, 2), protocols=("relaxation",), provenance="simulated")
    folder = write_study(tmp_path_factory.mktemp("influence"), fake)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(analyses, "REGISTRY", {"influence": "deabayes.analyses.influence"})
        analyses.run_all(context(), folder / "analyses")
    return StudyResults(folder)


def test_records_that_are_shown():
    records = context().experiments
    kept = influence.of_calibrated_response(records)
    assert {e.response_name for e in kept} == {"displacement"}
    assert [e.name for e in influence.strongest(kept)] == ["step_4kV", "sine_0p05Hz"]
    assert [e.name for e in influence.extremes(kept)] == ["step_2kV", "step_4kV"]


def test_table_of_indices(study):
    table = study.analysis("influence").tables["sobol"]
    assert set(table["candidate"]) == set(CANDIDATES)
    one = table[(table["candidate"] == "kv_gm_1") & (table["record"] == "step_2kV")]
    stages = ["at 0.5 s", "at 5 s", "at 50 s", "at 500 s", "0.5 to 5 s", "5 to 50 s", "50 to 500 s"]
    assert list(dict.fromkeys(one["stage"]))[:7] == stages
    early = one[one["stage"] == "at 0.5 s"].set_index("parameter")
    assert early["total"].idxmax() == "zeta_alpha"
    late = one[one["stage"] == "at 500 s"].set_index("parameter")
    assert late["total"].idxmax() == "mu_alpha"
    assert np.all(table["groups_left_out"] <= 0.01 * table["groups"])


def test_failed_draws_are_counted_as_the_curves_have_them(study):
    found = study.analysis("influence")
    table = found.tables["failed_draws"]
    row = table[(table["candidate"] == "kv_gm_1") & (table["record"] == "step_4kV")].iloc[0]
    curves = found.curves["prior_kv_gm_1_step_4kV"]
    assert row["draws"] == 200 and row["failed"] == int(curves["failed"].sum())
    assert 0.05 < row["share_percent"] / 100 < 0.4
    words = [part.rsplit(" ", 1) for part in row["what_failed"].split(", ")]
    assert sum(int(count) for _, count in words) == row["failed"]
    shown = curves["curve"].values
    np.testing.assert_array_equal(np.isnan(shown[:, 0]), curves["failed"].values[: len(shown)])
    which = found.tables["failed_parameters"].set_index(["candidate", "record", "parameter"])
    lower = which.loc[("kv_gm_1", "step_4kV")]["share_lower_percent"]
    assert lower["mu_alpha"] > 70 and lower["J_alpha"] < 30 and 35 < lower["J_beta"] < 65


def test_curves_moved_one_at_a_time(study):
    moved = study.analysis("influence").curves["one_at_a_time_kv_gm_2_step_4kV"]
    assert moved["curve"].shape[:2] == (8, 5)
    at = moved.sel(parameter="zeta_alpha", quantile=0.5)["curve"].values
    np.testing.assert_allclose(at, moved.sel(parameter="J_beta", quantile=0.5)["curve"].values)


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name, study):
    results = study if figures.module(name).SCOPE == "study" else study.candidates[0]
    drawn = figures.draw(name, results)
    assert len(drawn) == 2
    words = [t.get_text() for f in drawn for t in f.findobj(lambda a: hasattr(a, "get_text"))]
    assert any("step_4kV" in word for word in words)
    assert "simulated data" in words


def test_lost_draws_are_named_in_the_figures(study):
    def words(name, results):
        drawn = figures.draw(name, results)
        return " ".join(
            t.get_text() for f in drawn for t in f.findobj(lambda a: hasattr(a, "get_text"))
        )

    assert "fail: " in words("prior_curves", study)
    assert "no response at 6.7 kPa" in words("one_at_a_time", study.candidates[0])
    assert "draw fails" in words("sobol_indices", study.candidates[0])


@pytest.mark.parametrize("name", FIGURES)
def test_no_figure_without_the_analysis(name, tmp_path):
    bare = StudyResults(write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",))))
    results = bare if figures.module(name).SCOPE == "study" else bare.candidates[0]
    assert figures.draw(name, results) == []
