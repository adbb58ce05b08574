"""The solids that systems describe, against their own equations."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.cards import SPECIMENS, posterior

from deabayes.experiment import Excitation
from deabayes.export.source import system_and_draws
from deabayes.systems.membrane.material import Material, shares_at_prestretch
from deabayes.systems.solid import LINEAR, Solid
from deabayes.systems.tubular.voigt_kelvin import Chain

RATES = np.concatenate([np.geomspace(1e-4, 1e5, 10), 1j * np.geomspace(1e-4, 1e5, 10), [2 + 3j]])


def solid_of(system, candidate):
    built, draws = system_and_draws(posterior(system, candidate, size=20))
    return built, draws, built.solid(draws)


def laplace(solid):
    """s times the transform of G(t)/G_0, (W, R)."""
    grown = 1.0 / (1.0 + solid.times[:, :, None] * RATES)
    return 1.0 - np.sum(solid.shares[:, :, None] * grown, axis=1)


@pytest.mark.parametrize("units", [1, 2, 4])
def test_relaxation_inverts_creep(units):
    rng = np.random.default_rng(units)
    times = np.sort(np.exp(rng.normal(-3.0, 2.0, (30, units))), axis=1)
    chain = Chain(np.exp(rng.normal(-14.0, 1.0, 30)), np.exp(rng.normal(-15.0, 1.0, (30, units))),
                  times)  # fmt: skip
    shares, relaxation = chain.relaxation()
    grown = np.sum(shares[:, :, None] / (1.0 + relaxation[:, :, None] * RATES), axis=1)
    product = (1.0 - grown) / chain.instantaneous[:, None] * chain.complex_compliance(RATES)
    np.testing.assert_allclose(product, 1.0, rtol=0.0, atol=1e-10)
    assert np.all(shares > 0.0) and np.all(shares.sum(axis=1) < 1.0)
    assert np.all(relaxation < times) and np.all(np.diff(relaxation, axis=1) > 0.0)


def test_a_chain_that_is_none_relaxes_to_no_number():
    good = Chain(np.full(2, 1e-6), np.array([[1e-7], [np.nan]]), np.array([[0.1], [0.1]]))
    shares, times = good.relaxation()
    assert np.isfinite(shares[0, 0]) and np.isnan(shares[1, 0]) and np.isnan(times[1, 0])


@pytest.mark.parametrize("candidate", ["voigt_kelvin_1", "voigt_kelvin_3_inertia_circuit"])
def test_a_tubes_solid_creeps_in_uniaxial_stress_as_the_chain_does(candidate):
    """1/E* = 1/(3 G*) + 1/(9 K) with a bulk modulus that does not relax."""
    built, draws, solid = solid_of("tubular", candidate)
    young, ratio = solid.moduli["E"], solid.others["nu"]
    shear = (young / (2.0 * (1.0 + ratio)))[:, None] * laplace(solid)
    bulk = (young / (3.0 * (1.0 - 2.0 * ratio)))[:, None]
    chain = Chain.from_draws(draws, built.order)
    product = 9.0 * bulk * shear / (3.0 * bulk + shear) * chain.complex_compliance(RATES)
    np.testing.assert_allclose(product, 1.0, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(young, draws["E_0"])
    assert solid.law == LINEAR and solid.instantaneous


@pytest.mark.parametrize(
    "candidate", ["kv_gm_2", "ogden_2_units_2", "gent_units_1", "neo_hookean_units_2"]
)
def test_a_strips_solid_relaxes_as_the_strip_does_at_small_strain(candidate):
    """Nominal stress after a small step over its strain: 3 G(t)."""
    built, draws, solid = solid_of("tensile_strip", candidate)
    strain, last = 1e-4, float(5.0 * solid.times.max())
    start = 1e-4 * float(solid.times.min())
    knots = np.array([0.0, start, last])
    pulled = Excitation("stretch", "1", knots, 1.0 + strain * np.array([0.0, 1.0, 1.0]))
    times = np.geomspace(100.0 * start, last, 30)
    young = built.predict(pulled, times, "nominal_stress", draws) / strain
    instantaneous, long_term = solid.shear_moduli
    relaxed = np.exp(-times / solid.times[:, :, None])
    wanted = 3.0 * (
        long_term[:, None]
        + instantaneous[:, None] * np.sum(solid.shares[:, :, None] * relaxed, axis=1)
    )
    np.testing.assert_allclose(young, wanted, rtol=5e-4)


def test_a_membranes_times_are_those_at_its_prestretch():
    built, draws, solid = solid_of("membrane", "kv_gm_2")
    derived = built.derived(draws)
    for i in (1, 2):
        np.testing.assert_allclose(solid.times[:, i - 1], derived[f"relaxation_time_{i}"].values)
    np.testing.assert_allclose(solid.shear_moduli[0], derived["shear_modulus_total"].values)
    np.testing.assert_allclose(solid.shear_moduli[1], draws["mu_alpha"])
    assert np.all(solid.density == 960.0) and np.allclose(solid.invariant, 18.0 + 3.0**-4 - 3.0)


def test_shares_at_the_prestretch_are_those_of_the_equations():
    """(12) of Nguyen et al. 2021, differences of true stress with and without its units."""
    built, draws = system_and_draws(posterior("membrane", "kv_gm_2", size=20))
    at = 3.0

    def spring(stretch, dashpot, modulus, limit):
        elastic = stretch / dashpot
        argument = 1.0 - (2.0 * elastic**2 + elastic**-4 - 3.0) / limit
        return modulus * (stretch * dashpot**-2 - stretch**-5 * dashpot**4) / argument

    def changes(dashpot, modulus, limit):
        ends = [(at + h) * spring(at + h, dashpot, modulus, limit) for h in (1e-5, -1e-5)]
        return (ends[0] - ends[1]) / 2e-5

    alone = changes(1.0, draws["mu_alpha"], draws["J_alpha"])
    units = [changes(at, draws[f"mu_beta_{i}"], draws["J_beta"]) for i in (1, 2)]
    wanted = np.column_stack(units) / (alone + sum(units))[:, None]
    material = Material.from_draws(built.model, SPECIMENS["membrane"], draws)
    np.testing.assert_allclose(shares_at_prestretch(material), wanted, rtol=1e-6)


def test_times_below_which_the_dashpot_counts():
    """Right after a step of stress P_0 the stretch rises as 1 - exp(-t/time)."""
    for system, stiff in (("tensile_strip", 3.0), ("membrane", None)):
        _, draws, solid = solid_of(system, "kv_gm_1")
        told = next(note for note in solid.notes if "zeta_alpha" in note.text)
        np.testing.assert_allclose(told.values["zeta"], draws["zeta_alpha"])
        if stiff is not None:
            total = draws["mu_alpha"] + draws["mu_beta_1"]
            np.testing.assert_allclose(told.values["time"], draws["zeta_alpha"] / (stiff * total))
        else:
            x, limit = 18.0 + 3.0**-4 - 3.0, draws["J_alpha"]
            force, slope = 3.0 - 3.0**-5, 1.0 + 5.0 * 3.0**-6
            bent = slope / (1 - x / limit) + 4.0 * force**2 / limit / (1 - x / limit) ** 2
            stiffness = draws["mu_alpha"] * bent + draws["mu_beta_1"] * 6.0 / 9.0
            np.testing.assert_allclose(told.values["time"], draws["zeta_alpha"] / stiffness)


def test_a_films_solid_is_its_law_at_rest_and_tells_its_units():
    built, draws, solid = solid_of("minimum_energy_structure", "ogden_2_units_2")
    assert solid.times.size == 0 and not solid.instantaneous
    np.testing.assert_allclose(solid.shear_moduli[1], built.derived(draws)["mu_0"].values)
    along = 5.0 * np.cos(np.pi / 4.0)
    np.testing.assert_allclose(solid.invariant, along**2 + 25.0 + (5.0 * along) ** -2.0 - 3.0)
    said = " ".join(note.of(3) for note in solid.notes)
    for name, unit in (("k_1", "N/m"), ("k_2", "N/m"), ("tau_2", "s"), ("eta_0", "N s/m")):
        assert f"{name} = {draws[name][3]:.6g} {unit}" in said
    dry = solid_of("minimum_energy_structure", "ogden_1_units_1_dry")
    assert f"F_c = {dry[1]['friction_force'][0]:.6g} N" in dry[2].notes[-1].of(0)


def test_a_linear_solid_is_given_before_relaxation():
    one = np.ones(1)
    with pytest.raises(ValueError, match="must be instantaneous"):
        Solid(LINEAR, {"E": one}, {"nu": 0.4 * one}, False, one[:, None], one[:, None])
