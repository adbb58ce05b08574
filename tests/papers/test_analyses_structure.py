"""What the paper on the minimum-energy structure reports, from made-up posteriors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.shared import structure_contexts as made_up
from tests.shared.structure_contexts import MOVING, STATIC, computed, draws, exact, motion, static
from tests.shared.structures import FILM, STIFFNESS, VISCOSITY

from deabayes import papers
from deabayes.papers import minimum_energy_structure
from deabayes.papers.minimum_energy_structure import (
    force_curve,
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


@pytest.mark.parametrize("name", OF_STRUCTURE)
@pytest.mark.parametrize("study", ["static", "motion"])
def test_every_number_of_a_posterior_has_its_interval(name, study):
    for table in computed(name, study).tables.values():
        columns = [str(c) for c in table.columns]
        low = [c.removesuffix("_q05") for c in columns if c.endswith("_q05")]
        for base in low:
            (value,) = [c for c in columns if c == base or (c.rpartition("_")[0] == base
                        and c not in (f"{base}_q05", f"{base}_q95"))]  # fmt: skip
            inside = table[[value, f"{base}_q05", f"{base}_q95"]].dropna()
            assert np.all(inside[f"{base}_q05"] <= inside[f"{base}_q95"])


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


def test_the_made_up_records_are_as_they_should_be():
    assert STATIC[1] in static().candidates
    assert Cycles.of(made_up.sine(5.0, 1.0)).numbers.size == len(made_up.GROUPS)
    assert np.all(np.isfinite(made_up.sweep().response))
    assert draws("ogden_1_units_4")["tau_4"].size == 20
