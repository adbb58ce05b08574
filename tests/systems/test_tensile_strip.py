"""Tensile strip: golden tables, lanes, limits, mistakes."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.golden import golden_table, load_golden

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.systems import build, candidates
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.tensile_strip.system import TensileStrip

HISTORIES = {
    "strip_relaxation": ([0.0, 4.0, 1804.0], [1.0, 2.0, 2.0]),
    "strip_triangle": ([0.0, 40.0, 80.0], [1.0, 3.0, 1.0]),
}
BARE = Specimen("bare", "tensile_strip", {}, {})
TIGHT = 1e-12


def strip(candidate, tolerance=1e-6, specimen=BARE):
    return TensileStrip(candidate, specimen, tolerance)


def excitation(time, stretch, name="stretch", **conditions):
    unit = {"stretch": "1", "displacement": "m"}[name]
    return Excitation(name, unit, np.array(time, float), np.array(stretch, float), conditions)


def relaxation(top=2.5, hold=1800.0):
    ramp = (top - 1.0) / 0.25
    time = np.unique(np.r_[np.linspace(0.1, ramp, 40), ramp + np.geomspace(0.1, hold, 140)])
    return excitation([0.0, ramp, ramp + hold], [1.0, top, top]), time


def prior_draws(system, count, seed):
    rng = np.random.default_rng(seed)
    draws = {p.name: p.prior.from_normal(rng.standard_normal(count)) for p in system.parameters()}
    for group in {p.ordered for p in system.parameters()} - {None}:
        names = [p.name for p in system.parameters() if p.ordered == group]
        for name, values in zip(names, np.sort([draws[n] for n in names], axis=0), strict=True):
            draws[name] = values
    return draws


def some_draws(units=3, count=1, **changes):
    values = {"mu_alpha": 35e3, "zeta_alpha": 1e5, "J_alpha": 110.0, "J_beta": 55.0}
    for i, tau in zip(range(1, units + 1), (4.0, 33.5, 83.5, 400.0), strict=False):
        values |= {f"mu_beta_{i}": 15e3, f"tau_beta_{i}": tau}
    return {name: np.full(count, value) for name, value in (values | changes).items()}


def rows(draws, which):
    return {name: values[which] for name, values in draws.items()}


@pytest.mark.parametrize("units", [1, 2, 3])
@pytest.mark.parametrize("case", HISTORIES)
def test_golden(case, units):
    inputs, table = load_golden(case)["inputs"], golden_table(case, f"n{units}")
    draws = some_draws(units)
    for i in range(units):
        draws[f"tau_beta_{i + 1}"] = np.array([inputs["zeta_beta_Pa_s"][i] / 15e3])
    expected = table["nominal_stress"]
    for tolerance, relative in ((TIGHT, 1e-9), (1e-6, None)):
        system = strip(f"kv_gm_{units}", tolerance)
        found = system.predict(
            excitation(*HISTORIES[case]), table["time"], "nominal_stress", draws
        )[0]
        if relative is not None:
            np.testing.assert_allclose(found, expected, rtol=relative)
        assert np.max(np.abs(found - expected)) < 1e-6 * np.ptp(expected)


@pytest.mark.parametrize("candidate", ["kv_gm_1", "kv_gm_3", "ogden_2_units_2", "gent"])
def test_a_draw_does_not_depend_on_its_batch(candidate):
    system = strip(candidate)
    simulate = system.simulator(*relaxation(), "nominal_stress")
    draws = prior_draws(system, 37, 5)
    together = simulate(draws)
    alone = np.concatenate([simulate(rows(draws, [w])) for w in range(37)])
    np.testing.assert_array_equal(together, alone)
    shuffle = np.random.default_rng(6).permutation(37)
    np.testing.assert_array_equal(simulate(rows(draws, shuffle)), together[shuffle])
    first = system.parameters()[0].name
    spoiled = draws | {first: np.where(np.arange(37) % 3 == 0, np.nan, draws[first])}
    found = simulate(spoiled)
    assert np.all(np.isnan(found[::3]))
    kept = np.arange(37) % 3 != 0
    np.testing.assert_array_equal(found[kept], together[kept])


@pytest.mark.parametrize("spoiled", ["tau_beta_2", "J_beta", "mu_beta_1", "J_alpha"])
def test_a_failed_draw_is_a_row_of_nan_and_changes_no_other(spoiled):
    simulate = strip("kv_gm_3").simulator(*relaxation(), "nominal_stress")
    draws = some_draws(3, 5)
    expected = simulate(draws)
    bad = 1.0 if spoiled == "J_alpha" else np.nan
    draws[spoiled][2] = bad
    found = simulate(draws)
    assert np.all(np.isnan(found[2]))
    np.testing.assert_array_equal(found[[0, 1, 3, 4]], expected[[0, 1, 3, 4]])


@pytest.mark.parametrize("candidate", ["gent", "kv_gm_1"])
def test_a_spring_that_passes_its_limit_between_outputs_fails(candidate):
    """I_1 - 3 is 6.67 at the peak, 10 s into the history; later outputs see 3.25 at most."""
    history = excitation([0.0, 10.0, 20.0], [1.0, 3.0, 1.0])
    limits = np.array([5.0, 7.0])
    draws = some_draws(1, 2, J_alpha=limits)
    if candidate == "gent":
        draws = {"mu": draws["mu_alpha"], "J": limits}
    system = strip(candidate)
    after = system.predict(history, np.linspace(15.0, 20.0, 6), "nominal_stress", draws)
    np.testing.assert_array_equal(np.isnan(after), [[True] * 6, [False] * 6])
    before = system.predict(history, np.linspace(0.0, 5.0, 6), "nominal_stress", draws)
    assert np.all(np.isfinite(before))


def test_a_draw_passes_a_limit_by_its_own_gauge_length():
    specimen = Specimen("s", "tensile_strip", {}, {"gauge_length": Quantity(0.1, "m", 0.01)})
    history = excitation([0.0, 10.0, 20.0], [0.0, 0.2, 0.0], "displacement")
    draws = {"mu": np.full(2, 3e4), "J": np.full(2, 7.0), "gauge_length": np.array([0.09, 0.1])}
    system = strip("gent", specimen=specimen)
    found = system.predict(history, np.array([19.0, 20.0]), "nominal_stress", draws)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [True, False])


def test_a_unit_that_needs_countless_steps_fails_instead_of_hanging():
    """A proposal far outside the prior: stiff units that relax within milliseconds."""
    far = {"mu_1": -2e-8, "alpha_1": -5.0, "mu_beta_1": 2e7, "mu_beta_2": 7e9}
    draws = {n: np.array([v]) for n, v in (far | {"tau_1": 0.1, "tau_2": 0.2}).items()}
    found = strip("ogden_1_units_2").predict(*relaxation(), "nominal_stress", draws)
    assert np.all(np.isnan(found))


def test_small_strain_relaxation_is_a_prony_series():
    strain, ramp = 1e-4, 1e-3
    draws = some_draws(3, zeta_alpha=0.0)
    history = excitation([0.0, ramp, 1000.0], [1.0, 1.0 + strain, 1.0 + strain])
    time = np.geomspace(0.1, 1000.0, 60)
    found = strip("kv_gm_3", 1e-10).predict(history, time, "nominal_stress", draws)[0]
    modulus = np.full_like(time, 35e3)
    for tau in (4.0, 33.5, 83.5):
        modulus += 15e3 * np.exp(-3.0 * (time - ramp / 2) / tau)
    np.testing.assert_allclose(found, 3.0 * strain * modulus, rtol=5e-4)


def test_large_gent_limits_are_neo_hookean():
    kelvin = some_draws(2, J_alpha=1e12, J_beta=1e12, zeta_alpha=0.0)
    plain = {"mu": kelvin["mu_alpha"]} | {f"mu_beta_{i}": kelvin[f"mu_beta_{i}"] for i in (1, 2)}
    plain |= {f"tau_{i}": kelvin[f"tau_beta_{i}"] for i in (1, 2)}
    record = relaxation()
    first = strip("kv_gm_2", 1e-9).predict(*record, "nominal_stress", kelvin)
    second = strip("neo_hookean_units_2", 1e-9).predict(*record, "nominal_stress", plain)
    np.testing.assert_allclose(first, second, rtol=1e-8)


def test_outputs_in_any_order_and_outside_the_history():
    history, draws = excitation([0.0, 4.0], [1.0, 2.0]), some_draws(2)
    time = np.array([-1.0, 0.0, 2.0, 4.0, 10.0, 50.0])
    found = strip("kv_gm_2").predict(history, time, "nominal_stress", draws)[0]
    assert found[0] == pytest.approx(0.0, abs=1e-6)
    assert found[1] == pytest.approx(1e5 * 0.25)
    longer = excitation([0.0, 4.0, 50.0], [1.0, 2.0, 2.0])
    same = strip("kv_gm_2").predict(longer, time, "nominal_stress", draws)[0]
    np.testing.assert_allclose(found, same, rtol=1e-6, atol=1e-6)
    backwards = strip("kv_gm_2").predict(history, time[::-1], "nominal_stress", draws)[0]
    np.testing.assert_array_equal(backwards[::-1], found)


def test_displacement_and_force_are_stretch_and_stress():
    length, area = Quantity(0.08, "m"), Quantity(2e-5, "m^2")
    specimen = Specimen("s", "tensile_strip", {}, {"gauge_length": length, "cross_section": area})
    system, draws = strip("kv_gm_3", specimen=specimen), some_draws(3)
    history, time = relaxation()
    moved = excitation(history.coordinate, 0.08 * (history.values - 1.0), "displacement")
    stress = system.predict(history, time, "nominal_stress", draws)
    np.testing.assert_allclose(
        system.predict(moved, time, "force", draws), 2e-5 * stress, rtol=1e-12
    )


def test_uncertain_quantities_are_parameters_that_act():
    quantities = {
        "gauge_length": Quantity(0.08, "m", 1e-3),
        "cross_section": Quantity(2e-5, "m^2", 5e-7),
    }
    uncertain = strip("kv_gm_2", specimen=Specimen("u", "tensile_strip", {}, quantities))
    assert [p.name for p in uncertain.parameters()][-2:] == ["gauge_length", "cross_section"]
    exact = {name: Quantity(q.value * 1.02, q.unit) for name, q in quantities.items()}
    certain = strip("kv_gm_2", specimen=Specimen("c", "tensile_strip", {}, exact))
    draws = some_draws(2) | {n: np.array([q.value]) for n, q in exact.items()}
    history = excitation([0.0, 4.0, 100.0], [0.0, 0.08, 0.08], "displacement")
    time = np.linspace(0.0, 100.0, 41)
    found = uncertain.predict(history, time, "force", draws)
    expected = certain.predict(history, time, "force", draws)
    assert np.max(np.abs(found - expected)) < 1e-6 * np.ptp(expected)


@pytest.mark.parametrize("deformation", ["uniaxial", "equibiaxial", "pure_shear"])
def test_quasi_static_record_is_the_spring_alone(deformation):
    stretch = np.array([1.0, 1.5, 3.0, 2.0, 1.1])
    draws = {"mu": np.array([1e5, 2e5]), "J": np.array([80.0, 90.0])}
    held = {"protocol": "quasi_static", "deformation": deformation}
    history = excitation(stretch, stretch, **held)
    found = strip("gent").predict(history, stretch, "nominal_stress", draws)
    expected = SPRINGS["gent"].nominal_stress(stretch, draws, deformation)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("candidate", candidates("tensile_strip"))
def test_every_candidate_builds_and_responds(candidate):
    system = build("tensile_strip", candidate, BARE)
    names = [p.name for p in system.parameters()]
    assert len(set(names)) == len(names)
    draws = prior_draws(system, 3, 8)
    found = system.predict(*relaxation(2.0, 100.0), "nominal_stress", draws)
    assert found.shape == (3, 180)
    assert np.all(np.isfinite(found))
    assert all(d.values.shape == (3,) and d.unit for d in system.derived(draws).values())


def test_parameter_names_are_those_of_the_interface():
    def names(candidate):
        return [p.name for p in strip(candidate).parameters()]

    assert names("kv_gm_2") == ["mu_alpha", "zeta_alpha", "J_alpha", "mu_beta_1", "mu_beta_2",
                                "tau_beta_1", "tau_beta_2", "J_beta"]  # fmt: skip
    assert names("ogden_2_units_1") == ["mu_1", "mu_2", "alpha_1", "alpha_2", "mu_beta_1", "tau_1"]
    assert names("gent") == ["mu", "J"]
    assert names("neo_hookean") == ["mu"]
    assert strip("ogden_3").order == 3
    assert strip("ogden_3_units_2").order == 2


def test_derived_quantities():
    found = strip("kv_gm_2").derived(some_draws(2))
    assert found["shear_modulus_total"].values[0] == pytest.approx(65e3)
    assert found["shear_modulus_long_term"].values[0] == pytest.approx(35e3)
    assert found["relaxation_time_1"].values[0] == pytest.approx(4.0 * 4 / 3)
    assert found["zeta_beta_2"].values[0] == pytest.approx(15e3 * 33.5)


@pytest.mark.parametrize(
    ("candidate", "message"),
    [("kv_gm_9", "1 to 6"), ("kv_gn_2", "did you mean 'kv_gm_2'"), ("ogden", "needs terms"),
     ("gent_3", "takes no terms"), ("ogden_2_units_0", "1 to 6")],
)  # fmt: skip
def test_a_wrong_candidate_is_named(candidate, message):
    with pytest.raises(UserError, match=message):
        strip(candidate)


@pytest.mark.parametrize(
    ("candidate", "history", "response", "message"),
    [
        ("kv_gm_1", excitation([0, 1], [1, 2]), "force", "lacks cross_section, which a force"),
        ("kv_gm_1", excitation([0, 1], [0, 1], "displacement"), "nominal_stress", "gauge_length"),
        ("kv_gm_1", excitation([1, 2], [1, 2], protocol="quasi_static"), "nominal_stress",
         "needs time"),
        ("kv_gm_1", excitation([0, 1], [1, 2], deformation="pure_shear"), "nominal_stress",
         "uniaxial"),
        ("gent", excitation([0, 1], [1, 2], deformation="shear"), "nominal_stress",
         "simple shear is none"),
        ("kv_gm_1", excitation([0, 0], [1, 2]), "nominal_stress", "must ascend"),
        ("kv_gm_1", excitation([0, 1], [1, -2]), "nominal_stress", "positive"),
        ("kv_gm_1", excitation([0, 1], [1, 2]), "stress", "'stress' is unknown"),
    ],
)  # fmt: skip
def test_a_record_that_does_not_fit_is_named(candidate, history, response, message):
    with pytest.raises(UserError, match=message):
        strip(candidate).simulator(history, np.array([1.0, 2.0]), response)
