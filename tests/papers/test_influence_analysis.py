"""The analysis `influence` and its figures, on a made-up membrane study."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.contexts import CANDIDATES, context, experiment
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study
from tests.shared.membranes import sine

from deabayes import figures, papers
from deabayes.figures.results import StudyResults
from deabayes.papers.membrane import influence
from deabayes.papers.membrane.influence import loops_dataset
from deabayes.prediction.influence import PriorModel
from deabayes.prior.distributions import LogNormal
from deabayes.prior.joint import Prior

SHEETS = {"prior_curves": 2, "one_at_a_time": 2, "one_at_a_time_loops": 1, "sobol_indices": 3}
"""Figure -> its sheets, one per record that is shown."""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    fake = Fake(candidates=(1, 2), protocols=("relaxation",), provenance="simulated")
    folder = write_study(tmp_path_factory.mktemp("influence"), fake)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(papers, "REGISTRY", {"influence": "deabayes.papers.membrane.influence"})
        papers.run_all(context(), folder / "analyses")
    return StudyResults(folder)


def test_records_that_are_shown():
    records = context().experiments
    kept = influence.of_calibrated_response(records)
    assert {e.response_name for e in kept} == {"displacement"}
    assert [e.name for e in influence.strongest(kept)] == ["step_4kV", "sine_0p05Hz"]
    assert [e.name for e in influence.extremes(kept)] == ["step_2kV", "step_4kV", "sine_0p05Hz"]


def test_of_the_strongest_sines_the_slowest_and_the_fastest_are_asked():
    def driven(frequency, volts, periods=3):
        excitation = sine(frequency, periods, 40, volts)
        time = np.linspace(0.0, periods / frequency, 60)
        name = f"{frequency:g}Hz_{volts:g}V"
        return experiment(name, "sine", excitation, time, "displacement")

    records = [driven(0.05, 2e3), driven(0.01, 2e3), driven(0.02, 2e3), driven(0.001, 1e3),
               driven(0.5, 2e3, 1)]  # fmt: skip
    assert [e.name for e in influence.extremes(records)] == ["0.01Hz_2000V", "0.05Hz_2000V"]
    assert influence.extremes(records[-1:]) == []


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


def test_table_of_indices_of_a_sine(study):
    table = study.analysis("influence").tables["sobol"]
    one = table[(table["candidate"] == "kv_gm_1") & (table["record"] == "sine_0p05Hz")]
    stages = ["peak to peak, cycle 1", "peak to peak, cycle 5", "drift of the mean, 1 to 5",
              "loop area, cycle 5"]  # fmt: skip
    assert list(dict.fromkeys(one["stage"]))[:4] == stages
    area = one[one["stage"] == stages[3]].set_index("parameter")["total"]
    drift = one[one["stage"] == stages[2]].set_index("parameter")["total"]
    assert area["zeta_alpha"] > 0.1 and area["J_beta"] < 0.01
    assert drift["tau_beta_1"] > 0.1 > area["J_beta"]


def test_loops_moved_one_at_a_time(study):
    found = study.analysis("influence").curves["loops_kv_gm_1_sine_0p05Hz"]
    assert found["cycle"].values.tolist() == [1, 5]
    assert found.attrs["response_unit"] == "m"
    last = found.sel(cycle=5)
    plain = last["curve"].sel(parameter="zeta_alpha", quantile=0.5)
    np.testing.assert_allclose(plain, last["curve"].sel(parameter="J_beta", quantile=0.5))
    np.testing.assert_allclose(last["mean"], last["curve"].values[..., :-1].mean(axis=-1))
    top = np.ptp(last["curve"].sel(parameter="mu_alpha").values, axis=-1)
    assert np.all(np.diff(top) < 0.0), "a stiffer membrane moves less"
    creep = found["mean"].sel(parameter="mu_alpha").diff("cycle").values.ravel()
    assert np.all(np.diff(creep) < 0.0) and np.all(creep > 0.0)


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


@pytest.mark.parametrize("name", SHEETS)
def test_figures(name, study):
    results = study if figures.module(name).SCOPE == "study" else study.candidates[0]
    drawn = figures.draw(name, results)
    assert len(drawn) == SHEETS[name]
    words = [t.get_text() for f in drawn for t in f.findobj(lambda a: hasattr(a, "get_text"))]
    assert any("sine_0p05Hz" in word for word in words)
    assert any("step_4kV" in word for word in words) == (len(drawn) > 1)
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


def driven_membrane(volts, **priors):
    """A sine on a membrane of one unit, with other priors in place of the default ones."""
    about = context()
    (record,) = about.records("displacement", "sine")
    record = replace(record, excitation=sine(0.05, amplitude=volts))
    system = about.system_of("kv_gm_1")
    parameters = [replace(p, prior=priors.get(p.name, p.prior)) for p in system.parameters()]
    return PriorModel(system, Prior(parameters), record)


def drawn_with(curves, study, monkeypatch):
    """The figure of kv_gm_1 with these loops in place of the study's."""
    monkeypatch.setitem(study.analysis("influence").curves, "loops_kv_gm_1_sine_0p05Hz", curves)
    (figure,) = figures.draw("one_at_a_time_loops", study.candidates[0])
    return figure


def test_a_lost_loop_is_named_in_its_panel(study, monkeypatch):
    """The softest membrane is lost at 4.5 kV: it is said, the others' loops are drawn."""
    curves = loops_dataset(driven_membrane(4.5e3))
    lost = np.isnan(curves["area"].sel(parameter="mu_alpha")).all("cycle")
    assert lost.values.tolist() == [True, False, False, False, False]
    figure = drawn_with(curves, study, monkeypatch)
    assert "no response at 6.7 kPa" in [t.get_text() for t in figure.axes[0].texts]
    assert not figure.axes[1].texts
    drawn = [np.isfinite(line.get_ydata()).all() for line in figure.axes[0].lines]
    assert drawn.count(False) == 3, "its loop, its bar and its dot"


def test_a_figure_in_which_every_loop_is_lost(study, monkeypatch):
    """A Gent limit below the pre-stretch has no relaxed state."""
    curves = loops_dataset(driven_membrane(2e3, J_alpha=LogNormal(10.0, 0.01)))
    assert np.isnan(curves["curve"]).all()
    figure = drawn_with(curves, study, monkeypatch)
    assert all(len(ax.texts) == 1 for ax in figure.axes)


@pytest.mark.parametrize("name", SHEETS)
def test_no_figure_without_the_analysis(name, tmp_path):
    bare = StudyResults(write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",))))
    results = bare if figures.module(name).SCOPE == "study" else bare.candidates[0]
    assert figures.draw(name, results) == []
