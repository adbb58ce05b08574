"""Material cards read back: programs compute from them what the model computes; comments."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from tests.shared.cards import (
    PROGRAMS,
    READ,
    SPECIMENS,
    energy,
    nominal,
    posterior,
    sentences,
    written,
)
from tests.shared.fake_tables import whole

from deabayes.cli.main import cli
from deabayes.experiment import Quantity, Specimen
from deabayes.export import abaqus, ansys, export
from deabayes.export.cards import _name
from deabayes.export.source import evenly, system_and_draws
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree
from deabayes.systems import REGISTRY, candidates
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.tubular.material import POISSON_RATIO

STRETCHES = np.array([0.8, 1.1, 1.5, 2.0, 2.6])
CASES = [
    ("tensile_strip", "ogden_2_units_2"),
    ("tensile_strip", "ogden_4"),
    ("tensile_strip", "neo_hookean_units_1"),
    ("tensile_strip", "gent"),
    ("tensile_strip", "kv_gm_4"),
    ("membrane", "kv_gm_2"),
    ("minimum_energy_structure", "ogden_2_units_2"),
]


def medians(draws):
    return {name: np.array([np.median(values)]) for name, values in draws.items()}


def taken(tree, draws):
    """The draws that the cards are of."""
    every = system_and_draws(tree)[1]
    if draws is None:
        return medians(every)
    return {name: values[evenly(values.size, draws)] for name, values in every.items()}


def spring_stress(candidate, draws, deformation):
    """Stress (W, N) after relaxation, by the package's own law."""
    law = SPRINGS["gent" if "kv_gm" in candidate else candidate.split("_")[0].replace(
        "neo", "neo_hookean")]  # fmt: skip
    if "kv_gm" in candidate:
        draws = {"mu": draws["mu_alpha"], "J": draws["J_alpha"]}
    return law.nominal_stress(STRETCHES, draws, deformation)


def relaxed(material):
    return 1.0 - sum(material.shares) if material.moduli == "INSTANTANEOUS" else 1.0


@pytest.mark.parametrize("draws", [None, 3])
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(("system", "candidate"), CASES)
def test_stress_of_the_cards_is_that_of_the_model(system, candidate, program, draws, tmp_path):
    tree = posterior(system, candidate)
    cards = READ[program](written(tree, program, tmp_path, draws=draws))
    own = taken(tree, draws)
    series = program == "abaqus" and ("gent" in candidate or "kv_gm" in candidate)
    for deformation in ("uniaxial", "equibiaxial"):
        expected = spring_stress(candidate, own, deformation)
        for card, stress in zip(cards, expected, strict=True):
            got = relaxed(card) * nominal(energy(program, card), STRETCHES, deformation)
            np.testing.assert_allclose(got, stress, rtol=1e-2 if series else 1e-7)


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(("candidate", "factor"), [("kv_gm_3", 3.0), ("ogden_1_units_2", 3.0)])
def test_prony_series_of_a_strip(candidate, factor, program, tmp_path):
    tree = posterior("tensile_strip", candidate)
    own = taken(tree, 4)
    units = [name for name in own if name.startswith("mu_beta_")]
    total = sum(own[name] for name in units) + (
        own["mu_alpha"] if "mu_alpha" in own else 0.5 * own["mu_1"] * own["alpha_1"]
    )
    for k, card in enumerate(READ[program](written(tree, program, tmp_path, draws=4))):
        np.testing.assert_allclose(card.shares, [own[n][k] / total[k] for n in units], rtol=1e-8)
        times = [own[n][k] / factor for n in own if n.startswith("tau_")]
        np.testing.assert_allclose(card.times, times, rtol=1e-8)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_tubes_card_creeps_as_the_chain_does(program, tmp_path):
    """Laplace transforms: E*(s) of the card times D*(s) of the chain is one."""
    tree = posterior("tubular", "voigt_kelvin_2_circuit")
    own, s = taken(tree, 3), np.geomspace(1e-2, 1e4, 7)
    for k, card in enumerate(READ[program](written(tree, program, tmp_path, draws=3))):
        assert card.law == ("ELASTIC" if program == "abaqus" else "EX PRXY")
        assert card.moduli == "INSTANTANEOUS"
        young, ratio = card.data
        assert ratio == POISSON_RATIO and young == pytest.approx(own["E_0"][k], rel=1e-8)
        rest = sum(g / (1.0 + tau * s) for g, tau in zip(card.shares, card.times, strict=True))
        shear = young / (2.0 * (1.0 + ratio)) * (1.0 - rest)
        bulk = young / (3.0 * (1.0 - 2.0 * ratio))
        compliance = 1.0 / own["E_0"][k] + sum(
            1.0 / (own[f"E_{n}"][k] * (1.0 + own[f"tau_{n}"][k] * s)) for n in (1, 2)
        )
        np.testing.assert_allclose(9 * bulk * shear / (3 * bulk + shear) * compliance, 1, rtol=1e-8)


def test_abaqus_states_the_stretch_up_to_which_its_series_holds(tmp_path):
    """At the stated stretches the stress is one per cent too low."""
    text = written(posterior("membrane", "kv_gm_1"), "abaqus", tmp_path)
    said = next(each for each in sentences(text) if "no Gent law" in each)
    words = said.replace(",", "").split()
    own = taken(posterior("membrane", "kv_gm_1"), None)
    spring = {"mu": own["mu_alpha"], "J": own["J_alpha"]}
    for deformation, word in (("equibiaxial", "equal-biaxial"), ("uniaxial", "uniaxial")):
        at = np.array([float(words[words.index(word) - 1])])
        card = READ["abaqus"](text)[0]
        got = nominal(energy("abaqus", card), at, deformation)
        wanted = SPRINGS["gent"].nominal_stress(at, spring, deformation)[0]
        np.testing.assert_allclose(1.0 - got / wanted, 0.01, rtol=0.01)
    assert "NOTE: the specimen works" not in text


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("system", REGISTRY)
def test_every_candidate_has_a_card_or_is_refused_with_a_reason(system, program, tmp_path):
    also = {"tubular": ["circuit", "voigt_kelvin_2_inertia_circuit"],
            "minimum_energy_structure": ["ogden_1_units_1_dry"]}  # fmt: skip
    for candidate in [*candidates(system), *also.get(system, [])]:
        tree = posterior(system, candidate, size=6)
        if candidate == "circuit":
            with pytest.raises(UserError, match="circuit of system 'tubular' describes no solid"):
                written(tree, program, tmp_path)
            continue
        (card,) = READ[program](written(tree, program, tmp_path))
        assert card.data and all(np.isfinite([*card.data, *card.shares, *card.times])), candidate
        assert all(share > 0.0 for share in card.shares) and sum(card.shares) < 1.0


@pytest.mark.parametrize("program", PROGRAMS)
def test_cards_are_numbered_and_carry_the_density(program, tmp_path):
    tree = posterior("membrane", "kv_gm_2")
    cards = READ[program](written(tree, program, tmp_path, draws=12))
    names = [f"KV_GM_2_{k:04d}" if program == "abaqus" else str(k) for k in range(1, 13)]
    assert [card.name for card in cards] == names
    assert {card.density for card in cards} == {960.0}
    assert "Density: the specimen states none" not in written(tree, program, tmp_path)
    assert "Density: the specimen states none; add it" in sentences(
        written(posterior("tensile_strip", "gent"), program, tmp_path)
    )


def test_an_uncertain_density_is_each_draws_own(tmp_path):
    quantities = SPECIMENS["membrane"].quantities | {"density": Quantity(960.0, "kg/m^3", 20.0)}
    of = Specimen("plain", "membrane", {}, quantities)
    tree = posterior("membrane", "kv_gm_1_inertia", of=of)
    cards = READ["abaqus"](written(tree, "abaqus", tmp_path, draws=3))
    np.testing.assert_allclose([c.density for c in cards], taken(tree, 3)["density"], rtol=1e-8)


def test_abaqus_notes_that_the_specimen_is_beyond_the_series(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree["posterior"]["J_alpha"].values[:] *= 0.3
    text = written(tree, "abaqus", tmp_path)
    said = next(each for each in sentences(text) if "the specimen works beyond" in each)
    assert "I_1 - 3 = 15.01" in said and "UHYPER" in said
    assert "UHYPER" not in written(tree, "ansys", tmp_path)


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_header_names_candidate_provenance_and_convergence(program, tmp_path):
    tree = posterior("tubular", "voigt_kelvin_1", converged=False)
    said = sentences(written(tree, program, tmp_path))
    assert said[0] == "deabayes 0.1.0: voigt_kelvin_1 of system tubular, specimen tube"
    assert said[1] == "Provenance: SIMULATED records, not measurements"
    assert said[2] == "NOT CONVERGED: do not use these numbers"
    assert said[3].startswith("Units: SI") and said[4].startswith("Medians of 100 draws")
    converged = sentences(written(posterior("membrane", "kv_gm_1"), program, tmp_path, draws=2))
    assert converged[1:3] == ["Provenance: measured", "Converged"]
    assert converged[4].startswith("2 of 100 draws, evenly spaced")
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
def test_medians_that_are_no_typical_draw_are_noted(draws, tmp_path):
    """Half mu alpha is 1 of four draws in five and 4.5 of the fifth; of the medians it is 2."""
    tree = posterior("tensile_strip", "ogden_1")
    mu, alpha = tree["posterior"]["mu_1"].values, tree["posterior"]["alpha_1"].values
    kinds = np.arange(mu.size).reshape(mu.shape) % 5
    mu[:] = np.select([kinds < 2, kinds < 4], [1.0, 2.0], 3.0)
    alpha[:] = np.select([kinds < 2, kinds < 4], [2.0, 1.0], 3.0)
    said = " ".join(sentences(written(tree, "ansys", tmp_path, draws=draws)))
    told = "outside the central 50 % of the draws (1 to 1 Pa)" in said
    assert told == (draws is None)


def test_comments_name_what_a_card_lacks(tmp_path):
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
def test_impossible_options_are_refused(program, name, draws, words, tmp_path):
    ending = {"abaqus": "inp", "ansys": "mac or .inp"}[program]
    with pytest.raises(UserError) as caught:
        export(posterior("membrane", "kv_gm_1"), program, tmp_path / name, draws=draws)
    assert words.format(to=program, ending=ending) in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", [abaqus, ansys])
def test_a_law_without_a_card_is_refused(program, monkeypatch, tmp_path):
    """As a spring that is added to the registry only, or a law of one's own."""
    monkeypatch.delitem(getattr(program, program.__name__.rpartition(".")[2].upper()).laws, "gent")
    words = "no card is known for the law 'gent', only for linear_elastic, neo_hookean, ogden"
    with pytest.raises(UserError, match=words):
        program.write(posterior("membrane", "kv_gm_1"), tmp_path / "x.inp")
    assert list(tmp_path.iterdir()) == []


def test_names_are_ones_that_programs_take():
    assert _name("2.own model", "0001") == "M2_OWN_MODEL_0001"
    assert len(_name("x" * 200, "MEDIANS")) <= 80


def test_cards_of_numbers_that_are_not_finite_are_refused(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree["posterior"]["J_alpha"].values[:] = 5.0
    with pytest.raises(UserError, match="1 of 1 cards would hold numbers that are not finite"):
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


def test_the_header_names_a_population(tmp_path):
    tree = posterior("membrane", "kv_gm_1")
    tree.attrs |= {"population": "{}", "study_name": "batch"}
    said = sentences(written(tree, "abaqus", tmp_path))[0]
    assert (
        "system membrane, a new specimen of population batch (quantities outside the population are"
        in said
    )
