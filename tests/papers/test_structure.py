"""What the paper on the minimum-energy structure reports, from made-up posteriors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.shared import structure_contexts as made_up
from tests.shared.structure_contexts import MOVING, computed, exact, motion, static
from tests.shared.structures import FILM, STIFFNESS, VISCOSITY

from deabayes import papers
from deabayes.papers import hysteresis, minimum_energy_structure
from deabayes.papers.base import beside
from deabayes.papers.minimum_energy_structure import (
    error_against_phase,
    force_curve,
    structure_amplitude,
    structure_errors,
    structure_film,
    structure_units,
)
from deabayes.papers.timing import Cycles
from deabayes.report.tables import readable

OF_STRUCTURE = [n for n in papers.names_for("minimum_energy_structure") if "genetic" not in n]


"""The genetic algorithm is tested in test_genetic_algorithm.py: it takes its time."""


def test_the_papers_film_is_compared_term_by_term_and_as_a_whole():
    tables = computed("structure_film", "static").tables
    terms = tables["table_3_terms"].set_index(["candidate", "term"])
    assert terms.loc[("ogden_4", 1), "paper_mu_kPa"] == 73.98
    assert terms.loc[("ogden_4", 4), "paper_alpha"] == 3.306
    assert np.isnan(terms.loc[("ogden_1", 1), "paper_mu_kPa"])
    assert np.all(np.diff(terms.loc["ogden_4"]["paper_alpha"]) > 0.0)
    whole = tables["table_3_film"].set_index("candidate")
    mu_0 = 0.5e-3 * sum(FILM[f"mu_{i}"] * FILM[f"alpha_{i}"] for i in range(1, 5))
    assert whole.loc["paper", "mu_0_kPa"] == pytest.approx(mu_0)
    assert mu_0 == pytest.approx(167.21, abs=0.01)
    assert whole.loc["paper", "hinge_stiffness_mNmperrad"] == pytest.approx(25.138, abs=1e-3)
    for column in ("mu_0_kPa", "blocking_force_5kV_mN", "slider_stiffness_Nperm"):
        assert whole.loc["ogden_4", column] == pytest.approx(whole.loc["paper", column], rel=0.05)


def test_the_report_shows_the_papers_figures_too():
    table = readable(computed("structure_film", "static").tables["table_3_film"])
    (paper,) = [row for row in table["rows"] if row[0] == "paper"]
    shown = dict(zip(table["header"], paper, strict=True))
    assert shown["mu 0 (kPa)"] == "167.2" and shown["hinge stiffness (mN·m/rad)"] == "25.14"
    assert "[" in table["rows"][0][table["header"].index("mu 0 (kPa)")]


def test_what_the_prior_knew_alone_is_not_determined():
    made = static()
    prior = made.prior_of("ogden_1")
    before = prior.sample(np.random.default_rng(3), 8000).T
    unknowing = replace(
        made.candidates["ogden_1"], draws=dict(zip(prior.names, before, strict=True))
    )
    known_film = replace(made.candidates["ogden_1"], draws=dict(made.candidates["ogden_1"].draws))
    found = {}
    for name, fitted in (("prior", unknowing), ("posterior", known_film)):
        context = replace(made, candidates={"ogden_1": fitted})
        table = structure_film.compute(context).tables["film_determined"].set_index("quantity")
        found[name] = table["contraction_percent"]
    assert np.all(np.abs(found["prior"][["alpha_1", "relative_permittivity"]]) < 10.0)
    # mu spans decades of both signs: quantiles of thousands of draws are good to a tenth.
    assert abs(found["prior"]["mu_1"]) < 30.0
    assert np.all(found["posterior"] > 90.0)


def test_force_errors_are_relative_to_the_range():
    table = force_curve.compute(exact(static(), 0.01)).tables["force_errors"]
    assert list(table["voltage_kV"].unique()) == [0.0, 2.0, 5.0]
    np.testing.assert_allclose(table[["e_m_percent", "e_rms_percent"]], 1.0)
    assert set(table["paper_below_percent"]) == {6.0}


def test_the_papers_forces_are_those_of_its_film():
    curve = computed("force_curve", "static").curves["quasi_static_5kV"]
    # The record was made with the paper's film.
    np.testing.assert_allclose(curve["paper"], curve["measured"], rtol=1e-12)
    assert curve.attrs["voltage_kV"] == 5.0
    at_rest = curve["measured"].sel(displacement=0.0, method="nearest")
    assert float(at_rest) == pytest.approx(0.1493, abs=1e-3)


def test_units_stand_beside_the_papers_where_there_are_as_many():
    tables = computed("structure_units", "motion").tables
    units = tables["table_4_units"].set_index(["candidate", "unit"])
    assert len(units) == 5
    for i in range(1, 5):
        row = units.loc[("ogden_1_units_4", i)]
        assert (row["paper_k_Nperm"], row["paper_xi_Nsperm"]) == (
            STIFFNESS[i - 1], VISCOSITY[i - 1]
        )  # fmt: skip
        assert row["xi_Nsperm"] == pytest.approx(VISCOSITY[i - 1], rel=0.03)
        assert row["paper_tau_s"] == pytest.approx(row["tau_s"], rel=0.03)
    assert np.isnan(units.loc[("ogden_1_units_1", 1), "paper_k_Nperm"])
    assert set(tables["table_4_friction"]["paper_eta_0_Nsperm"]) == {0.1}


def test_dry_friction_is_no_viscosity():
    made = motion().candidates["ogden_1_units_1"]
    values = {n: v for n, v in made.draws.items() if n != "eta_0"}
    dry = replace(made, draws=values | {"friction_force": np.full(20, 2e-3)})
    row = structure_units.friction_row(dry)
    assert row["dry_friction_mN"] == pytest.approx(2.0)
    assert "paper_eta_0_Nsperm" not in row


def test_table_5_has_the_voltages_side_by_side_and_the_papers_figures():
    table = computed("structure_errors", "motion").tables["table_5_errors"]
    assert list(table["frequency_Hz"]) == [1.0, 5.0, 10.0] * 2
    found = table.set_index(["candidate", "frequency_Hz"])
    assert found.loc[("ogden_1_units_1", 5.0), "paper_e_rms_5kV_percent"] == 3.88
    assert found.loc[("ogden_1_units_4", 10.0), "paper_e_rms_4kV_percent"] == 10.78
    assert set(table["role_5kV"]) == {"calibrate"} and set(table["role_4kV"]) == {"validate"}
    one, four = (found.loc[name, "e_rms_5kV_percent"] for name in MOVING)
    assert np.all(four < 2.0) and np.all(one > 10.0)


def test_late_errors_are_of_the_second_half():
    made = motion()
    (record,) = [e for e in made.experiments if e.name == "sine_5kV_5Hz"]
    half = 0.5 * (made_up.START + record.coordinate[-1])
    early = np.where(record.coordinate <= half, 0.1 * record.response_range, 0.0)
    found = structure_errors.errors(record, np.tile(record.response - early, (3, 1)))
    assert found["e_rms_late_percent"] == 0.0
    share = np.mean(record.coordinate <= half)
    assert 0.5 < share < 1.0
    assert found["e_rms_percent"] == pytest.approx(10.0 * np.sqrt(share))


@pytest.mark.parametrize(
    ("kilovolts", "hertz", "printed"),
    [(5.0002, 1.0, 6.14), (4.0, 6.0001, 7.25), (3.0, 1.0, None), (5.0, 5.3, None)],
)
def test_the_papers_table_5(kilovolts, hertz, printed):
    found = minimum_energy_structure.e_rms(kilovolts, hertz)
    assert np.isnan(found) if printed is None else found == printed
    assert np.isnan(minimum_energy_structure.e_rms(5.0, 12.0))


def test_each_study_has_what_its_records_are_about():
    forces = {"structure_film", "force_curve"}
    for name in OF_STRUCTURE:
        for study, there in (("static", name in forces), ("motion", name not in forces)):
            found = computed(name, study)
            assert bool(found.tables or found.curves) == there
            assert all(isinstance(t, pd.DataFrame) and len(t) for t in found.tables.values())


@pytest.mark.parametrize("name", papers.names_for("minimum_energy_structure"))
def test_a_single_held_out_record_is_enough_not_to_fail(name):
    for context in (static(), motion()):
        only = [e for e in context.experiments if e.role == "validate"][:1]
        papers.module(name).compute(replace(context, experiments=only))


@pytest.mark.parametrize("name", OF_STRUCTURE)
def test_a_candidate_without_any_response_costs_no_analysis(name):
    """As where every draw is pulled in by one record; and a sine of no cycle, a sweep of none."""
    phase = np.linspace(0.0, 0.9, 90)
    short = made_up.moving(
        "short", "sine", made_up.driven_from_rest(phase, made_up.command(5.0, phase)),
        made_up.START + phase,
    )  # fmt: skip
    brief = replace(made_up.sweep(2.0, 2.0, 0.2), name="brief")
    for context, more in ((static(), []), (motion(), [short, brief])):
        first, last = context.candidates
        lost = {
            (first, each.name): np.full((1, each.coordinate.size), np.nan)
            for each in context.experiments
        }
        experiments = [*context.experiments, *more]
        found = replace(context, experiments=experiments, _responses=lost)
        for table in papers.module(name).compute(found).tables.values():
            assert last in set(table.get("candidate", [last]))


def test_the_phase_is_counted_from_the_lowest_voltage():
    record = made_up.sine(5.0, 5.0)
    at = (np.arange(made_up.POINTS) + 0.5) / made_up.POINTS - 0.05
    np.testing.assert_allclose(
        error_against_phase.phase(record)[20:40], at % 1.0, atol=1e-3
    )  # fmt: skip
    points = error_against_phase.stable_points(record)
    assert set(points) == set(range(120, 140))
    lowest = record.excitation.at(record.coordinate[points])
    assert np.argmin(lowest) in (0, 19) and np.argmax(lowest) in (9, 10)


def test_a_negative_voltage_is_read_like_a_positive_one():
    """It makes the same motion; after the step `cycles` it ended in an IndexError."""
    record = made_up.sine(5.0, 5.0)
    turned = replace(record.excitation, values=-record.excitation.values)
    negative = replace(record, excitation=turned)
    np.testing.assert_array_equal(
        error_against_phase.phase(negative), error_against_phase.phase(record)
    )
    assert structure_amplitude.levels(negative) == structure_amplitude.levels(record)
    assert structure_amplitude.levels(negative)[0] == pytest.approx(500.0)


def test_a_voltage_whose_cycles_are_not_seen_has_no_phase():
    """A rest at zero before a small sine about a bias: only the step `cycles` knows them."""
    record = made_up.sine(5.0, 5.0)
    drive = record.excitation
    biased = np.where(drive.values > 0.0, 4e3 + 0.1 * drive.values, 0.0)
    small = replace(record, excitation=replace(drive, values=biased))
    assert Cycles.of(small).starts.size and error_against_phase.stable_points(small).size == 0
    assert structure_amplitude.levels(small)[1] == pytest.approx(4.5e3)


def test_errors_of_the_stable_cycle():
    found = error_against_phase.compute(exact(motion(), 0.02))
    assert len(found.curves) == 6
    table = found.tables["phase_errors"]
    columns = [f"{what}_{kV}kV_percent" for what in ("largest", "mean") for kV in (5, 4)]
    np.testing.assert_allclose(table[columns], 2.0)
    curve = found.curves["sine_4kV_10Hz"]
    assert np.all(np.diff(curve["phase"]) > 0.0)
    np.testing.assert_allclose(curve["error"], 2.0)
    back = curve["measured"] - 0.02 * made_up.sine(4.0, 10.0).response_range
    np.testing.assert_allclose(curve["predicted"].sel(bound="median")[0], back)


def test_creep_is_counted_between_the_cycles_that_are_there():
    tables = hysteresis.compute(exact(motion())).tables
    cycles = tables["hysteresis_cycles"]
    one = cycles[(cycles["candidate"] == MOVING[0]) & (cycles["experiment"] == "sine_5kV_1Hz")]
    assert list(one["cycle"]) == [1, 2, 3, 4, 5, 8, 13]
    mean, drift = 1e3 * one["measured_mean_mm"].to_numpy(), one["measured_drift_um"].to_numpy()
    assert drift[-1] == pytest.approx((mean[-1] - mean[-2]) / 5.0)
    np.testing.assert_allclose(one["predicted_drift_um"][1:], drift[1:], rtol=1e-9)
    stable = tables["hysteresis_stability"]
    assert set(stable["measured_stable_from"]) <= {1.0, 2.0, 3.0, 4.0, 5.0, 8.0}
    first = stable[stable["experiment"] == "sine_5kV_1Hz"].iloc[0]
    assert first["measured_creep_um"] == pytest.approx(mean[-1] - mean[0])


def test_the_predicted_curve_meets_the_records():
    found = computed("structure_amplitude", "motion")
    bands = found.curves["bands_5kV"]
    four = bands["predicted"].sel(candidate=MOVING[1], bound="median")
    table = found.tables["structure_amplitude"].set_index(["candidate", "frequency_Hz"])
    for hertz in (1.0, 10.0):
        at = float(four.sel(frequency=hertz, method="nearest")) / 1e-3
        assert at == pytest.approx(table.loc[(MOVING[1], hertz), "predicted_5kV_mm"], rel=0.01)
    assert bands.attrs["lowest_kV"] == pytest.approx(0.5, abs=0.01)
    assert float(bands["frequency"][-1]) > 40.0 and bands.attrs["last_sine_Hz"] < 10.1
    assert float(found.curves["bands_4kV"]["frequency"][-1]) < 10.1
    record = made_up.sine(4.0, 5.0)
    row = structure_amplitude.record_row(record, np.tile(1.1 * record.response, (3, 1)))
    assert row["error_percent"] == pytest.approx(10.0)
    assert row["measured_mm"] == pytest.approx(1e3 * np.ptp(record.response[-20:]), rel=0.01)


def test_rows_of_two_voltages_are_joined():
    head = {"candidate": "a", "order": 1, "converged": True, "frequency_Hz": 2.0}
    rows = [head | {"voltage_kV": v, "e_mm": v, "e_q05": -v, "role": "x"} for v in (4.0, 5.0)]
    (found,) = beside(rows)
    assert list(found)[4:] == ["e_5kV_mm", "e_5kV_q05", "role_5kV", "e_4kV_mm", "e_4kV_q05",
                               "role_4kV"]  # fmt: skip
    assert found["e_4kV_q05"] == -4.0


def test_a_voltage_recorded_twice_at_one_frequency_keeps_both_rows():
    head = {"candidate": "a", "order": 1, "converged": True, "frequency_Hz": 2.0}
    recorded = [(5.0, 1.0), (4.0, 2.0), (5.001, 3.0)]
    found = beside([head | {"voltage_kV": v, "e_mm": e} for v, e in recorded])
    assert found == [
        head | {"e_5kV_mm": 3.0, "e_4kV_mm": 2.0},
        head | {"e_5kV_mm": 1.0},
    ]


def test_two_sines_of_one_frequency_have_one_curve_between_them():
    context = motion()
    first = next(e for e in context.experiments if e.name == "sine_5kV_1Hz")
    twice = [first, replace(first, name="again")]
    bands = structure_amplitude.sine_curves(context, twice, [])
    assert bands["frequency"].size == 1 and bands["measured"].size == 2
