"""The analysis `influence` and its figures, and what parameters do to a sine's cycles."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtri
from tests.shared.contexts import CANDIDATES, context, experiment
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study
from tests.shared.membranes import sine

from deabayes import figures, papers
from deabayes.experiment import Experiment
from deabayes.figures.results import StudyResults
from deabayes.papers.membrane import influence
from deabayes.papers.membrane.influence import cycle_stages, has_cycles, loops_dataset
from deabayes.papers.timing import PHASES
from deabayes.prediction.influence import PriorModel, stage_sensitivity
from deabayes.prior.distributions import LogNormal, Uniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter

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


@pytest.fixture(scope="module")
def drawn(study):
    """Figures of the study and of its first candidate, by name."""
    scopes = {"study": study, "candidate": study.candidates[0]}
    return {name: figures.draw(name, scopes[figures.module(name).SCOPE]) for name in SHEETS}


def words(drawn):
    return [t.get_text() for f in drawn for t in f.findobj(lambda a: hasattr(a, "get_text"))]


@pytest.mark.parametrize("name", SHEETS)
def test_figures_have_a_sheet_per_record(name, drawn):
    assert len(drawn[name]) == SHEETS[name]
    found = words(drawn[name])
    assert any("sine_0p05Hz" in word for word in found)
    assert any("step_4kV" in word for word in found) == (SHEETS[name] > 1)
    assert "simulated data" in found


def test_failed_draws_are_named_in_the_figures(drawn):
    assert "fail: " in " ".join(words(drawn["prior_curves"]))
    assert "no response at 6.7 kPa" in words(drawn["one_at_a_time"])
    assert "draw fails" in " ".join(words(drawn["sobol_indices"]))


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


VOLTS, PERIOD, CYCLES = 2e3, 20.0, 4


MISSED = 1.0 - np.cos(2.0 * np.pi / PHASES)


"""Of an amplitude, at most: a peak of cos 2x lies half a spacing beside the even phases."""


HARDLY = LogNormal(1e-12, 1.0)


SIZE, LAG = LogNormal(1e-3, 0.5), Uniform(0.2, 0.8)


def parameter(name, prior):
    return Parameter(name, name, "1", "", prior, "made up")


class Lagging:
    """u = p [1 - cos(2x - d)]/2 + s t, x the phase of the voltage, sin d = `lag`, s = `creep`.

    Its amplitude is p; the mean rises by s T a cycle; -int u d|V sin x| over both polarities
    is (4/3) p V sin d + (2/pi) s T V. In the first cycle p is a share `first` of itself.
    Draws of p above `most` fail.
    """

    def __init__(self, creep=HARDLY, first=1.0, most=np.inf):
        self.first, self.most = first, most
        self.known = (parameter("size", SIZE), parameter("lag", LAG), parameter("creep", creep))

    def parameters(self):
        return self.known

    def predict(self, excitation, coordinate, response, draws):
        size, lag, creep = (draws[n][:, None] for n in ("size", "lag", "creep"))
        phase = 2.0 * np.pi * np.asarray(coordinate) / PERIOD
        grown = size * np.where(coordinate < 1.5 * PERIOD, self.first, 1.0)
        found = grown * (1.0 - np.cos(2.0 * phase - np.arcsin(lag))) / 2.0 + creep * coordinate
        return np.where(size > self.most, np.nan, found)


def model(periods=CYCLES, **changes):
    system = Lagging(**changes)
    time = np.linspace(0.0, periods * PERIOD, 20 * periods + 1)
    record = Experiment(
        "sine", "sine", "validate", "time", "s", time, "displacement", "m",
        np.zeros(time.size), np.ones(time.size), sine(1.0 / PERIOD, periods, amplitude=VOLTS),
    )  # fmt: skip
    return PriorModel(system, Prior(system.parameters()), record)


def test_stages_are_the_closed_forms():
    about = model(creep=LogNormal(1e-5, 0.3))
    z = np.random.default_rng(1).standard_normal((40, 3))
    size, lag, creep = (about.parameters(z)[name] for name in about.names)
    found = cycle_stages(about, z)
    assert list(found) == [
        "peak to peak, cycle 1", "peak to peak, cycle 4", "drift of the mean, 1 to 4",
        "loop area, cycle 4",
    ]  # fmt: skip
    rise = creep * PERIOD
    np.testing.assert_allclose(found["drift of the mean, 1 to 4"], (CYCLES - 1) * rise, rtol=1e-9)
    area = 4.0 / 3.0 * size * VOLTS * lag + 2.0 / np.pi * rise * VOLTS
    np.testing.assert_allclose(found["loop area, cycle 4"], area, rtol=2e-3)
    still = cycle_stages(model(), z)
    for cycle in (1, 4):
        np.testing.assert_allclose(still[f"peak to peak, cycle {cycle}"], size, rtol=MISSED)


def test_the_first_cycle_is_told_from_the_last():
    about = model(first=0.5)
    z = np.random.default_rng(1).standard_normal((40, 3))
    size, lag = (about.parameters(z)[name] for name in ("size", "lag"))
    found = cycle_stages(about, z)
    np.testing.assert_allclose(found["peak to peak, cycle 1"], 0.5 * size, rtol=MISSED)
    np.testing.assert_allclose(found["peak to peak, cycle 4"], size, rtol=MISSED)
    np.testing.assert_allclose(found["drift of the mean, 1 to 4"], 0.25 * size, rtol=1e-6)
    area = 4.0 / 3.0 * size * VOLTS * lag
    np.testing.assert_allclose(found["loop area, cycle 4"], area, rtol=2e-3)


def relative_variance(prior, region):
    """Variance over squared mean of an independent factor within the central region."""
    u = 0.5 + region * ((np.arange(200_000) + 0.5) / 200_000 - 0.5)
    values = prior.from_normal(ndtri(u))
    return np.var(values) / np.mean(values) ** 2


def test_indices_of_a_product_of_independent_factors():
    """Area = p sin d: S_p = v_p / D, S_Tp = v_p (1 + v_d) / D, D = (1 + v_p)(1 + v_d) - 1."""
    found = stage_sensitivity(model(), cycle_stages, 1024, np.random.default_rng(2))
    assert (found.region, found.failed) == (0.9, 0)
    size, lag = (relative_variance(prior, found.region) for prior in (SIZE, LAG))
    whole = (1.0 + size) * (1.0 + lag) - 1.0
    area = found.by_stage["loop area, cycle 4"]
    np.testing.assert_allclose(area.first_order, np.array([size, lag, 0.0]) / whole, atol=0.01)
    total = np.array([size * (1.0 + lag), lag * (1.0 + size), 0.0]) / whole
    np.testing.assert_allclose(area.total, total, atol=0.01)
    np.testing.assert_allclose(
        found.by_stage["peak to peak, cycle 1"].first_order, [1.0, 0.0, 0.0], atol=0.01
    )
    np.testing.assert_allclose(
        found.by_stage["drift of the mean, 1 to 4"].total, [0.0, 0.0, 1.0], atol=0.01
    )


def test_draws_that_fail_narrow_the_region():
    most = float(SIZE.from_normal(ndtri(np.array(0.9))))
    found = stage_sensitivity(model(most=most), cycle_stages, 128, np.random.default_rng(3))
    assert found.region == pytest.approx(0.8) and found.failed == 0


def test_a_record_that_is_no_sine_of_two_cycles_is_not_asked():
    assert has_cycles(model().experiment)
    assert not has_cycles(model(periods=1).experiment)
    flat = SimpleNamespace(protocol="step")
    assert not has_cycles(flat)
