"""The membrane's tables, against cases small enough to compute by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from tests.shared.contexts import CANDIDATES, computed, context, draws, experiment
from tests.shared.membranes import membrane, step, voltage

from deabayes import papers
from deabayes.experiment import Excitation, Experiment
from deabayes.papers import amplitude, hysteresis
from deabayes.papers.base import band, interval
from deabayes.papers.membrane import (
    amplitude_frequency,
    error_against_time,
    membrane_table_1,
    membrane_table_2,
    pull_in,
    response_stages,
)
from deabayes.papers.timing import Cycles, Loops

TIME = np.array([1.0, 4.0, 6.0, 100.0])


FLAT = np.array([0.1, 0.3, 0.4, 0.5])


def record(response, protocol="step", driven=None, time=TIME, name="displacement"):
    made = experiment("made_up", protocol, driven or step(4e3), time, name)
    return replace(made, response=np.array(response, float))


def test_an_interval_leaves_failed_draws_out_and_keeps_the_value_given():
    found = interval("e", "percent", [1.0, np.nan, 3.0], 2.5)
    assert found == {"e_percent": 2.5, "e_q05": pytest.approx(1.1), "e_q95": pytest.approx(2.9)}
    assert interval("x", "", np.arange(11.0))["x"] == 5.0
    np.testing.assert_allclose(band(np.arange(11.0)[:, None])[:, 0], [0.5, 5.0, 9.5])


def test_step_errors_before_and_after_five_seconds():
    curves = np.array([[0.15, 0.3, 0.42, 0.5], [0.15, 0.3, 0.42, 0.5], [0.1, 0.3, 0.4, 0.4]])
    found = membrane_table_1.step_errors(record(FLAT), curves)
    # The range is 0.5, from rest at 0, not 0.4; the median curve is the first.
    assert found["overshoot_percent"] == pytest.approx(100 * 0.05 / 0.5)
    assert found["e_m_percent"] == pytest.approx(100 * 0.02 / 0.5)
    assert found["e_m_q95"] == pytest.approx(np.quantile([4.0, 4.0, 20.0], 0.95))


def test_sine_errors():
    found = membrane_table_1.sine_errors(record([0.0, 1.0, 0.0, -1.0]), np.full((2, 4), 0.5))
    assert found["e_rms_percent"] == pytest.approx(100 * np.sqrt((0.5 + 4.5 / 1.8) / 4) / 2)
    assert found["e_m_percent"] == pytest.approx(75.0)


def test_area_errors_are_relative_to_the_measured_area():
    areas = record([1000.0, 1000.0, 1010.0, 1020.0], name="area")
    curves = np.stack([np.full(4, 1015.0), np.full(4, 1015.0), np.full(4, 1040.0)])
    found = membrane_table_2.area_errors(areas, curves)
    assert found["overall_percent"] == pytest.approx(1.5)
    assert found["overall_q95"] == pytest.approx(np.quantile([1.5, 1.5, 4.0], 0.95))
    assert found["after_overshoot_percent"] == pytest.approx(100 * 5 / 1010)


def test_table_1_has_a_row_per_candidate_and_record_and_the_papers_figures():
    tables = computed("membrane_table_1").tables
    steps = tables["table_1_step"].set_index(["candidate", "experiment"])
    assert len(steps) == 6
    assert steps.loc[("kv_gm_1", "step_4kV"), "paper_e_m_percent"] == 21.42
    assert steps.loc[("kv_gm_2", "step_4kV"), "paper_overshoot_percent"] == 10.26
    assert steps.loc[("kv_gm_2", "step_3kV")].isna()["paper_e_m_percent"]
    (sines,) = tables["table_1_alternating"].groupby("experiment")
    assert list(sines[1]["paper_e_rms_percent"]) == [15.796, 11.553]
    # The record was made with three units; two are nearer to it than one.
    errors = steps["e_m_percent"].unstack("candidate")
    assert np.all(errors["kv_gm_2"] < errors["kv_gm_1"])
    areas = computed("membrane_table_2").tables["table_2_area"].set_index("experiment")
    assert set(areas.loc["area_4kV", "paper_percent"]) == {1.674}
    assert set(areas.loc["area_2kV", "paper_camera_percent"]) == {6.149}


def test_error_curves_are_signed_and_relative_to_the_range():
    made = context()
    exact = made.records("displacement", "step")[0]
    name = CANDIDATES[0]
    made._responses[name, exact.name] = np.tile(
        exact.response - 0.01 * exact.response.max(), (3, 1)
    )
    (curve,) = [
        c for n, c in error_against_time.compute(made).curves.items() if n == exact.name
    ]  # fmt: skip
    np.testing.assert_allclose(curve["error"].sel(candidate=name), 1.0)
    assert list(curve["bound"].values) == ["lower", "median", "upper"]
    assert curve["time"].values[0] == exact.coordinate[0]


def test_shares_and_stages():
    times = np.array([0.5, 1.0, 30.0, 100.0])
    curve = np.array([0.2, 0.25, 0.75, 1.0])
    np.testing.assert_allclose(response_stages.gained(times, curve), [25.0, 50.0, 25.0])
    np.testing.assert_allclose(
        response_stages.share_at(times, np.stack([curve, 2 * curve]), [0.75, 65.0]),
        [[22.5, 87.5]] * 2,
    )


def test_stages_of_a_record_add_up_and_follow_the_model():
    tables = computed("response_stages").tables
    total = tables["stages"].groupby(["candidate", "voltage_kV"])["measured_percent"].sum()
    np.testing.assert_allclose(total, 100.0)
    shares = tables["displacement_shares"]
    assert set(shares["time_s"]) == set(response_stages.TIMES)
    late = shares[shares["time_s"] == 300.0]
    # Fewer units, so less creep is left after 300 s than three show.
    assert np.all(late["predicted_percent"] > late["measured_percent"])


def loops(lag, creep=0.0, cycles=4):
    """Displacement (sin^2 of a lagging phase, creeping) against a sine of 1 V."""
    phase = np.linspace(0.0, 1.0, 97) + np.arange(cycles)[:, None]
    u = np.sin(2 * np.pi * phase - lag) ** 2 + creep * phase
    return Loops(u, np.sin(2 * np.pi * phase))


def test_the_area_of_a_loop():
    assert np.max(np.abs(loops(0.0).area)) < 1e-3
    # u = (1 - cos(2x - 2a))/2: -int u d|sin x| over both polarities is (4/3) sin 2a.
    np.testing.assert_allclose(loops(0.1).area, 4 / 3 * np.sin(0.2), rtol=2e-3)
    assert np.all(loops(-0.1).area < 0.0)
    np.testing.assert_allclose(loops(0.1).mean, 0.5, atol=1e-12)
    np.testing.assert_allclose(np.diff(loops(0.1, creep=0.3).mean), 0.3)
    np.testing.assert_allclose(loops(0.1).peak_to_peak, 1.0, rtol=2e-3)


def test_when_a_loop_is_stable():
    assert loops(0.1).stable_from() == 1.0
    assert np.isnan(loops(0.1, creep=0.1).stable_from())
    early = loops(0.1)
    early.displacement[0] *= 2.0
    assert early.stable_from() == 2.0
    last = loops(0.1)
    last.displacement[3] *= 2.0
    assert np.isnan(last.stable_from())


def test_measured_and_predicted_loops_of_the_same_curve_agree():
    made = context()
    (driven,) = made.records("displacement", "sine")
    for name in CANDIDATES:
        made._responses[name, driven.name] = np.tile(driven.response, (3, 1))
    tables = hysteresis.compute(made).tables
    cycles = tables["hysteresis_cycles"]
    np.testing.assert_allclose(cycles["measured_area_kVmm"], cycles["predicted_area_kVmm"])
    assert np.all(cycles["measured_area_kVmm"] > 0.0)
    drift = cycles["measured_drift_um"].to_numpy().reshape(2, -1)
    assert np.all(np.isnan(drift[:, 0])) and np.all(drift[:, 1:] > 0.0)


def test_the_amplitude_of_a_record_is_that_of_its_last_cycles():
    made = context()
    (driven,) = made.records("displacement", "sine")
    cycles = Cycles.of(driven)
    squared = 2e-3 * (driven.excitation.at(driven.coordinate) / 2e3) ** 2
    growing = squared * np.where(driven.coordinate < cycles.starts[-2], 0.5, 1.0)
    found = amplitude_frequency.of_record(driven, growing, cycles)
    assert float(found) == pytest.approx(2e-3, rel=5e-3)


def test_amplitudes_over_the_grid_agree_with_the_records():
    found = computed("amplitude_frequency")
    table = found.tables["amplitude_frequency"].set_index("candidate")
    bands = found.curves["bands"]["predicted"].sel(bound="median").interp(frequency=0.05) / 1e-3
    for name in CANDIDATES:
        assert float(bands.sel(candidate=name)) == pytest.approx(
            table.loc[name, "predicted_mm"], rel=0.01
        )


def test_bands_are_of_as_many_cycles_as_the_voltage_had(monkeypatch):
    """Not as many as the step `cycles` leaves groups of."""
    groups = {"step": "cycles", "period_s": 20.0, "first_cycle_s": 0.0, "group_sizes": [1, 1, 3]}
    made = context()
    records = [replace(each, steps=(groups,)) for each in made.records("displacement", "sine")]
    asked = []
    monkeypatch.setattr(
        amplitude, "settled_amplitude", lambda *given: asked.append(given[3]) or FLAT
    )
    found = amplitude_frequency.predicted_curve(made, records, 2e3)
    assert list(Cycles.of(records[0]).numbers) == [1, 2, 4]
    assert found.attrs["cycles"] == 4 and set(asked) == {4}


def test_pull_in_and_steady_stretch_are_the_models_own():
    found = computed("pull_in")
    table = found.tables["steady_stretch"].set_index(["candidate", "voltage_kV"])
    system, at = membrane("kv_gm_1"), draws(1)
    steady = system.steady_stretch(at, 3e3)
    assert table.loc[("kv_gm_1", 3.0), "steady_stretch"] == pytest.approx(np.median(steady))
    assert table.loc[("kv_gm_1", 3.0), "paper_parameters"] == 3.210
    assert table.loc[("kv_gm_1", 3.0), "steady_stretch"] == pytest.approx(3.210, abs=0.01)
    ends = found.tables["pull_in"].set_index("candidate")
    assert ends.loc["kv_gm_1", "pull_in_kV"] == pytest.approx(
        np.median(system.pull_in(at).voltage) / 1e3
    )
    curve = found.curves["steady_stretch"]
    np.testing.assert_allclose(curve["stretch"].isel(voltage=0), 3.0)
    assert float(curve["voltage"][-1]) == 5e3


def test_beyond_pull_in_there_is_no_steady_stretch():
    made = context()
    soft = {n: np.append(v[:-1], 5e3 if n == "mu_alpha" else 1e9 if n == "J_alpha" else v[-1])
            for n, v in draws(1, 3, 0.0).items()}  # fmt: skip
    made = replace(made, candidates={"kv_gm_1": replace(made.candidates["kv_gm_1"], draws=soft)})
    table = pull_in.compute(made).tables["steady_stretch"].set_index("voltage_kV")
    assert table.loc[4.0, "beyond_percent"] == pytest.approx(100 / 3)
    assert np.isfinite(table.loc[4.0, "steady_stretch"])


@pytest.mark.parametrize("name", papers.names_for("membrane"))
def test_every_analysis_does_without_the_records_it_is_about(name):
    made = context()
    only = [e for e in made.experiments if e.response_name == "area"]
    made = replace(made, experiments=only[:1])
    found = papers.module(name).compute(made)
    assert all(isinstance(table, pd.DataFrame) and len(table) for table in found.tables.values())


@pytest.mark.parametrize("name", [n for n in papers.names_for("membrane") if n != "influence"])
def test_a_candidate_that_pulls_in_in_every_draw_costs_no_analysis(name):
    made = context()
    softer = {n: v * (0.3 if n[:2] in ("mu", "ze") else 1e4 if n[:2] == "J_" else 1.0)
              for n, v in draws(1).items()}  # fmt: skip
    soft = replace(made.candidates["kv_gm_1"], draws=softer)
    made = replace(made, candidates=dict(made.candidates) | {"kv_gm_1": soft}, _responses={})
    found = papers.module(name).compute(made)
    assert all("kv_gm_2" in set(t.get("candidate", ["kv_gm_2"])) for t in found.tables.values())


def test_a_step_that_starts_late_is_counted_from_its_start():
    late = voltage([0.0, 5.0, 5.1, 600.0], [0.0, 0.0, 4e3, 4e3])
    made = record([0.1, 0.2, 0.3, 0.5], driven=late, time=np.array([6.0, 9.0, 11.0, 100.0]))
    curves = np.tile(made.response + np.array([0.05, 0.0, 0.01, 0.0]), (2, 1))
    found = membrane_table_1.step_errors(made, curves)
    assert found["overshoot_percent"] == pytest.approx(10.0)
    assert found["e_m_percent"] == pytest.approx(2.0)


STEP_TIMES = np.array([0.5, 1.0, 30.0, 100.0])


def stepped(name, *shares):
    """A step to 4 kV that has gone these shares of its last millimetre."""
    return Experiment(
        name, "step", "calibrate", "time", "s", STEP_TIMES, "displacement", "m",
        1e-3 * np.array([*shares, 1.0]), np.ones(4),
        Excitation("voltage", "V", np.array([0.0, 100.0]), np.array([4e3, 4e3])),
    )  # fmt: skip


def test_steps_to_one_voltage_are_told_apart():
    first, again = stepped("first", 0.1, 0.2, 0.5), stepped("again", 0.2, 0.6, 0.7)
    fitted = SimpleNamespace(system=SimpleNamespace(order=1), converged=True)
    context = SimpleNamespace(
        candidates={"kv_gm_1": fitted},
        records=lambda *names: [first, again],
        responses=lambda name, each: np.tile(each.response, (5, 1)),
    )
    found = response_stages.compute(context)
    stages = found.tables["stages"].set_index("experiment")
    for each, gained in ((first, [20.0, 30.0, 50.0]), (again, [60.0, 10.0, 30.0])):
        np.testing.assert_allclose(stages.loc[each.name, "measured_percent"], gained)
        np.testing.assert_allclose(stages.loc[each.name, "predicted_percent"], gained)
    (sheet,) = response_stages.draw(None, found)
    bars = [[bar.get_height() for bar in ax.patches] for ax in sheet.axes[2:]]
    np.testing.assert_allclose(bars, [[20.0, 30.0, 50.0], [60.0, 10.0, 30.0]])
