"""What material cards say of themselves, and cards that are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from tests.shared.cards import PROGRAMS, posterior, sentences, written
from tests.shared.fake_tables import whole

from deabayes.cli.main import cli
from deabayes.export import abaqus, ansys, export
from deabayes.export.cards import _name
from deabayes.export.source import system_and_draws
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree


def test_abaqus_says_that_the_specimen_is_beyond_the_series(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree["posterior"]["J_alpha"].values[:] *= 0.3
    text = written(tree, "abaqus", tmp_path)
    said = next(each for each in sentences(text) if "the specimen itself is beyond" in each)
    assert "I_1 - 3 = 15.01" in said and "UHYPER" in said
    assert "UHYPER" not in written(tree, "ansys", tmp_path)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_file_says_what_it_is_of(program, tmp_path):
    tree = posterior("tubular", "voigt_kelvin_1", converged=False)
    said = sentences(written(tree, program, tmp_path))
    assert said[0] == "deabayes 0.1.0: voigt_kelvin_1 of system tubular, specimen tube"
    assert said[1] == "Provenance: SIMULATED records, not measurements"
    assert said[2] == "NOT CONVERGED: do not use these numbers"
    assert said[3].startswith("Units: SI") and said[4].startswith("Medians of 100 draws")
    converged = sentences(written(posterior("membrane", "kv_gm_1"), program, tmp_path, draws=2))
    assert converged[1:3] == ["Provenance: measured", "Converged"]
    assert converged[4].startswith("2 of 100 draws, taken evenly")
    assert "Ensemble 1, draw 25 of the posterior file, both from 0" in converged


def test_shear_moduli_stand_beside_the_posteriors(tmp_path):
    tree = posterior("tensile_strip", "kv_gm_1")
    draws = system_and_draws(tree)[1]
    total = draws["mu_alpha"] + draws["mu_beta_1"]
    low, median, high = np.quantile(total, (0.05, 0.5, 0.95))
    said = sentences(written(tree, "abaqus", tmp_path))
    assert any(f"instantaneous {median:.5g} Pa ({low:.5g} to {high:.5g})" in each for each in said)
    own = np.median(draws["mu_alpha"]) + np.median(draws["mu_beta_1"])
    assert any(f"of this card: instantaneous {own:.5g} Pa, long-term" in each for each in said)
    assert not any("no typical draw" in each for each in said)
    elastic = sentences(written(posterior("tensile_strip", "gent"), "abaqus", tmp_path))
    assert not any("instantaneous" in each or "*VISCO" in each for each in elastic)


@pytest.mark.parametrize("draws", [None, 7])
def test_medians_that_are_no_typical_draw_are_told(draws, tmp_path):
    """Half mu alpha is 1 of four draws in five and 4.5 of the fifth; of the medians it is 2."""
    tree = posterior("tensile_strip", "ogden_1")
    mu, alpha = tree["posterior"]["mu_1"].values, tree["posterior"]["alpha_1"].values
    kinds = np.arange(mu.size).reshape(mu.shape) % 5
    mu[:] = np.select([kinds < 2, kinds < 4], [1.0, 2.0], 3.0)
    alpha[:] = np.select([kinds < 2, kinds < 4], [2.0, 1.0], 3.0)
    said = " ".join(sentences(written(tree, "ansys", tmp_path, draws=draws)))
    told = "outside of the central 50 % of the draws' (1 to 1 Pa)" in said
    assert told == (draws is None)


def test_notes_of_what_a_card_lacks(tmp_path):
    def said(system, candidate):
        return " ".join(sentences(written(posterior(system, candidate), "abaqus", tmp_path)))

    kelvin, ogden = said("tensile_strip", "kv_gm_2"), said("tensile_strip", "ogden_2_units_2")
    assert "zeta_alpha = " in kelvin and "J_beta = " in kelvin and "at stretch 1" in kelvin
    assert "zeta_alpha" not in ogden and "units are neo-Hookean" in ogden
    assert "units are neo-Hookean" not in said("tensile_strip", "neo_hookean_units_2")
    for relaxing in (kelvin, ogden, said("membrane", "kv_gm_1")):
        assert "Finite-strain relaxation" in relaxing and "hybrid elements" in relaxing
    assert "at the pre-stretch lambda = 3" in said("membrane", "kv_gm_1")
    assert "Finite-strain" not in said("tensile_strip", "ogden_2")
    tube = said("tubular", "voigt_kelvin_2")
    assert "Poisson's ratio 0.495" in tube and "hybrid" not in tube and "circuit" not in tube
    whole = said("tubular", "voigt_kelvin_2_inertia_circuit")
    assert "Masses of" in whole and "capacitance of the circuit" in whole


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    ("name", "draws", "words"),
    [
        ("x.csv", None, "--to {to} writes .{ending}"),
        ("x.py", None, "--to {to} writes .{ending}"),
        ("x.inp", 0, "--draws 0: the posterior holds 100 draws; take 1 to 100"),
        ("x.inp", 101, "--draws 101: the posterior holds 100 draws"),
    ],
)
def test_what_cannot_be_is_said(program, name, draws, words, tmp_path):
    ending = {"abaqus": "inp", "ansys": "mac or .inp"}[program]
    with pytest.raises(UserError) as caught:
        export(posterior("membrane", "kv_gm_1"), program, tmp_path / name, draws=draws)
    assert words.format(to=program, ending=ending) in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", [abaqus, ansys])
def test_a_law_that_a_program_has_no_card_for_is_told(program, monkeypatch, tmp_path):
    """As a spring that is added to the registry only, or a law of one's own."""
    monkeypatch.delitem(program.LAWS, "gent")
    words = "no card of .* is known for the law 'gent', only for linear_elastic, neo_hookean, ogden"
    with pytest.raises(UserError, match=words):
        program.write(posterior("membrane", "kv_gm_1"), tmp_path / "x.inp")
    assert list(tmp_path.iterdir()) == []


def test_names_are_ones_that_programs_take():
    assert _name("2.own model", "0001") == "M2_OWN_MODEL_0001"
    assert len(_name("x" * 200, "MEDIANS")) <= 80


def test_cards_of_no_numbers_are_refused(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree["posterior"]["J_alpha"].values[:] = 5.0
    with pytest.raises(UserError, match="1 of 1 cards would hold no finite numbers"):
        written(tree, "abaqus", tmp_path)


def test_the_command_writes_cards(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree.attrs["convergence"] = json.dumps({"converged": False})
    write_tree(whole(tree), tmp_path / "posterior.nc")
    command = ["export", str(tmp_path / "posterior.nc"), "--to", "ansys", "--draws", "3", "-o"]
    result = CliRunner().invoke(cli, [*command, str(tmp_path / "a.mac")])
    assert result.exit_code == 0 and "NOT CONVERGED" in result.stderr
    assert (tmp_path / "a.mac").read_text() == written(tree, "ansys", tmp_path, draws=3)
    assert CliRunner().invoke(cli, [*command[:-2], "0", "-o", "b.mac"]).exit_code == 2


def test_a_population_is_no_specimen(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree.attrs |= {"population": "{}", "study_name": "batch"}
    said = sentences(written(tree, "abaqus", tmp_path))[0]
    assert "system membrane, a new specimen of population batch (what the population does" in said
