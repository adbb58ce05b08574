"""Material cards read back: what the programs compute from them is what the model computes."""

from __future__ import annotations

import numpy as np
import pytest
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

from deabayes.experiment import Quantity, Specimen
from deabayes.export.source import evenly, system_and_draws
from deabayes.faults import UserError
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


def spring_stress(system, candidate, draws, deformation):
    """The spring that is left when all has relaxed, (W, N), by the package's own law."""
    law = SPRINGS["gent" if "kv_gm" in candidate else candidate.split("_")[0].replace(
        "neo", "neo_hookean")]  # fmt: skip
    if "kv_gm" in candidate:
        draws = {"mu": draws["mu_alpha"], "J": draws["J_alpha"]}
    return law.nominal_stress(STRETCHES, draws, deformation)


def relaxed(material):
    return 1.0 - sum(material.shares) if material.moduli == "INSTANTANEOUS" else 1.0


@pytest.mark.parametrize("deformation", ["uniaxial", "equibiaxial"])
@pytest.mark.parametrize("draws", [None, 3])
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(("system", "candidate"), CASES)
def test_stress_of_the_cards_is_the_springs(
    system, candidate, program, draws, deformation, tmp_path
):
    tree = posterior(system, candidate)
    cards = READ[program](written(tree, program, tmp_path, draws=draws))
    wanted = spring_stress(system, candidate, taken(tree, draws), deformation)
    assert len(cards) == len(wanted)
    series = program == "abaqus" and ("gent" in candidate or "kv_gm" in candidate)
    for card, own in zip(cards, wanted, strict=True):
        got = relaxed(card) * nominal(energy(program, card), STRETCHES, deformation)
        np.testing.assert_allclose(got, own, rtol=1e-2 if series else 1e-7)


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


def test_abaqus_says_up_to_where_the_series_holds(tmp_path):
    """At the stretches that it names the series falls short by one per cent, no more."""
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
    assert "NOTE: the specimen itself" not in text


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("system", REGISTRY)
def test_every_candidate_has_a_card_or_says_why_not(system, program, tmp_path):
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
