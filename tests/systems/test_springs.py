"""Spring laws: stress is the derivative of the energy, and limits agree."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.faults import UserError
from deabayes.systems.springs import DEFORMATIONS, REGISTRY, PrincipalStretches, principal_stretches

STRETCH = np.array([0.7, 0.95, 1.0, 1.05, 1.5, 2.5, 4.0])


def neo_hookean_energy(stretches, draws):
    return draws["mu"] / 2 * (sum(s**2 for s in stretches) - 3)


def gent_energy(stretches, draws):
    invariant = sum(s**2 for s in stretches) - 3
    return -draws["mu"] * draws["J"] / 2 * np.log(1 - invariant / draws["J"])


def ogden_energy(stretches, draws):
    terms = [i for i in range(1, 9) if f"mu_{i}" in draws]
    return sum(
        draws[f"mu_{i}"]
        / draws[f"alpha_{i}"]
        * (sum(s ** draws[f"alpha_{i}"] for s in stretches) - 3)
        for i in terms
    )


CASES = {
    "neo_hookean": (neo_hookean_energy, {"mu": 35e3}),
    "gent": (gent_energy, {"mu": 35e3, "J": 110.0}),
    "ogden": (
        ogden_energy,
        {"mu_1": -4e3, "mu_2": 50e3, "mu_3": 2e3, "alpha_1": -2.0, "alpha_2": 0.7, "alpha_3": 4.0},
    ),
}
# In the pulled direction P is dW/dlambda; equal-biaxial pulls two directions at once.
DIRECTIONS = {"uniaxial": 1.0, "pure_shear": 1.0, "equibiaxial": 2.0}


def as_draws(values, count=1):
    return {name: np.full(count, value) for name, value in values.items()}


def default_draws(name):
    """The median of every parameter's default prior, moved a little apart."""
    spring = REGISTRY[name]
    parameters = spring.parameters(3 if spring.counts_terms else 1)
    z = np.linspace(-0.3, 0.4, len(parameters))
    return {
        p.name: np.atleast_1d(p.prior.from_normal(each))
        for p, each in zip(parameters, z, strict=True)
    }


@pytest.mark.parametrize("name", REGISTRY)
def test_stress_comes_from_an_energy(name):
    """dP_1/dlambda_2 = dP_2/dlambda_1, so that a cycle of any shape costs no work."""

    def pulled(first, second):
        """Nominal stress in direction 1 of an incompressible sheet, [Pa]."""
        sheet = PrincipalStretches(first, second, 1.0 / (first * second))
        return REGISTRY[name].cauchy_stress(sheet, draws)[0] / first

    draws, step = default_draws(name), 1e-4
    first, second = np.array([1.1, 1.6, 0.9, 2.0]), np.array([1.3, 1.1, 2.2, 2.1])
    along_2 = pulled(first, second + step) - pulled(first, second - step)
    along_1 = pulled(second, first + step) - pulled(second, first - step)
    scale = np.max(np.abs(pulled(first, second)))
    np.testing.assert_allclose(along_2 / scale, along_1 / scale, atol=1e-8)


@pytest.mark.parametrize("name", REGISTRY)
def test_there_is_no_stress_at_rest_and_the_slope_is_three_shear_moduli(name):
    draws, strain = default_draws(name), 1e-5
    stress = REGISTRY[name].nominal_stress(np.array([1 - strain, 1.0, 1 + strain]), draws)[0]
    modulus = float(REGISTRY[name].shear_modulus(draws)[0])
    assert stress[1] == pytest.approx(0.0, abs=1e-12 * modulus)
    assert (stress[2] - stress[0]) / (6 * strain) == pytest.approx(modulus, rel=1e-6)


@pytest.mark.parametrize("deformation", DEFORMATIONS)
@pytest.mark.parametrize("name", CASES)
def test_stress_is_the_derivative_of_the_energy(name, deformation):
    energy, values = CASES[name]

    def total(stretch):
        return energy(principal_stretches(stretch, deformation), values)

    step = 1e-3 * STRETCH
    slope = (
        8 * (total(STRETCH + step) - total(STRETCH - step))
        - (total(STRETCH + 2 * step) - total(STRETCH - 2 * step))
    ) / (12 * step)
    stress = REGISTRY[name].nominal_stress(STRETCH, as_draws(values, 2), deformation)
    assert stress.shape == (2, STRETCH.size)
    np.testing.assert_allclose(stress[1] * DIRECTIONS[deformation], slope, rtol=1e-8, atol=1e-4)


def test_gent_is_nan_at_and_past_its_limit_and_only_there():
    draws = {"mu": np.array([1e4, 1e4]), "J": np.array([2.0, 50.0])}
    limit_stretch = 2.0  # uniaxial I1 - 3 = 4 + 1 - 3 = 2
    stress = REGISTRY["gent"].nominal_stress(np.array([1.5, limit_stretch, 3.0]), draws)
    np.testing.assert_array_equal(np.isnan(stress), [[False, True, True], [False] * 3])


@pytest.mark.parametrize("name", REGISTRY)
def test_parameters_bind_to_the_law_and_name_a_source(name):
    spring = REGISTRY[name]
    terms = 3 if spring.counts_terms else 1
    parameters = spring.parameters(terms)
    draws = {p.name: np.atleast_1d(p.prior.from_normal(0.0)) for p in parameters}
    assert np.all(np.isfinite(spring.nominal_stress(np.array([1.0, 1.5]), draws)))
    assert all(p.source and p.symbol and p.description for p in parameters)


def test_default_gent_prior_keeps_treloar_rubber_and_dragon_skin():
    modulus, limit = REGISTRY["gent"].parameters()
    for value in (13.7e3, 0.4e6):
        assert abs(modulus.prior.to_normal(value)) < 1.65
    # Treloar's record ends at stretch 7.6: I1 - 3 = 55.
    assert limit.prior.to_normal(55.0) < 0.0


def test_unknown_deformation_is_named():
    with pytest.raises(UserError, match="did you mean 'equibiaxial'"):
        principal_stretches(STRETCH, "equi-biaxial")
