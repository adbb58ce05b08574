import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.golden import golden_table, load_golden
from tests.shared.tubes import QUANTITIES

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.tubular.system import Tubular

TRUTH = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}


def specimen(**changes):
    quantities = {
        "thickness": Quantity(80e-6, "m"),
        "relative_permittivity": Quantity(3.1, "1"),
        "active_length": Quantity(0.07, "m"),
    }
    quantities |= changes
    return Specimen("tube", "tubular", {"kind": "simulated"}, quantities)


def draws(size=1, **changes):
    return {name: np.full(size, value) for name, value in (TRUTH | changes).items()}


def step(voltage, at=0.0):
    return Excitation("voltage", "V", np.array([at, at]), np.array([0.0, voltage]))


@pytest.mark.parametrize("units", [1, 2, 3])
def test_golden_creep_compliance(units):
    table = golden_table("tubular_creep_compliance", "creep")
    inputs = load_golden("tubular_creep_compliance")["inputs"]
    elements = inputs["Kelvin_elements"][str(units)]
    values = {"E_0": inputs["E0_Pa"]}
    values |= {f"E_{n}": value for n, value in enumerate(elements["E_Pa"], start=1)}
    values |= {f"tau_{n}": value for n, value in enumerate(elements["tau_s"], start=1)}
    strain = Tubular(f"voigt_kelvin_{units}", specimen()).predict(
        step(inputs["voltage_V"]),
        table["time"],
        "strain",
        {name: np.array([value]) for name, value in values.items()},
    )
    np.testing.assert_allclose(strain[0], table[f"strain_K{units}"], rtol=1e-12)


def test_any_voltage_history_matches_a_general_solver():
    knots = np.linspace(0.0, 0.3, 301)
    voltage = 1250.0 * (1 - np.cos(2 * np.pi * 10 * knots)) + 800.0 * np.interp(
        knots, [0.1, 0.15, 0.25], [0, 1, 0]
    )
    time = np.linspace(0.0, 0.3, 101)
    excitation = Excitation("voltage", "V", knots, voltage)

    def slope(t, x):
        pressure = maxwell_pressure(excitation.at(t), 80e-6, 3.1)
        return [
            (pressure / TRUTH["E_1"] - x[0]) / TRUTH["tau_1"],
            (pressure / TRUTH["E_2"] - x[1]) / TRUTH["tau_2"],
        ]

    solution = solve_ivp(
        slope, (0, 0.3), [0, 0], "DOP853", time, rtol=1e-12, atol=1e-15, max_step=1e-3
    )
    expected = solution.y.sum(axis=0) + maxwell_pressure(excitation.at(time), 80e-6, 3.1) / 1.5e6
    strain = Tubular("voigt_kelvin_2", specimen()).predict(excitation, time, "strain", draws())
    np.testing.assert_allclose(strain[0], expected, atol=1e-9 * expected.max())


def test_displacement_is_strain_times_length_and_a_delayed_step_is_the_same_step():
    time = np.linspace(0.0, 0.5, 26)
    system = Tubular("voigt_kelvin_2", specimen())
    strain = system.predict(step(2000.0), time, "strain", draws(2))
    displacement = system.predict(step(2000.0, at=0.02), time + 0.02, "displacement", draws(2))
    np.testing.assert_allclose(displacement, 0.07 * strain, rtol=1e-12)


def test_parameters_carry_units_symbols_and_an_ordered_group():
    parameters = Tubular("voigt_kelvin_3", specimen()).parameters()
    names = [p.name for p in parameters]
    assert names == ["E_0", "E_1", "E_2", "E_3", "tau_1", "tau_2", "tau_3"]
    assert [p.unit for p in parameters] == ["Pa"] * 4 + ["s"] * 3
    assert [p.ordered for p in parameters] == [None] * 4 + ["tau"] * 3
    assert len({p.prior for p in parameters if p.ordered}) == 1
    assert all(p.source for p in parameters)


def test_a_quantity_with_an_sd_becomes_a_parameter_and_counts():
    uncertain = specimen(
        thickness=Quantity(80e-6, "m", 2e-6, "caliper"), capacitance=Quantity(180e-9, "F", 5e-9)
    )
    system = Tubular("voigt_kelvin_1", uncertain)
    parameter = system.parameters()[-1]
    assert parameter.name == "thickness"
    assert parameter.source == "caliper"
    assert parameter.prior.support[0] == 0.0
    assert len(system.parameters()) == 4
    values = draws(2) | {"thickness": np.array([80e-6, 40e-6])}
    strain = system.predict(step(1000.0), np.array([0.1]), "strain", values)
    assert strain[1, 0] == pytest.approx(4 * strain[0, 0], rel=1e-14)


def test_derived_quantities_by_hand():
    values = {
        k: v.values for k, v in Tubular("voigt_kelvin_2", specimen()).derived(draws()).items()
    }
    pressure = 8.8541878188e-12 * 3.1 * (1000 / 80e-6) ** 2
    assert values["strain_per_kV2_0"] == pytest.approx(pressure / 1.5e6)
    assert values["strain_per_kV2_2"] == pytest.approx(pressure / 6e6)
    total = 1 / 1.5e6 + 1 / 12e6 + 1 / 6e6
    assert values["compliance_total"] == pytest.approx(total)
    assert values["strain_per_kV2_total"] == pytest.approx(pressure * total)
    assert values["eta_1"] == pytest.approx(12e6 * 6e-3)
    expected = 1 / 1.5e6 + (1 - np.exp(-0.1 / 6e-3)) / 12e6 + (1 - np.exp(-0.1 / 0.12)) / 6e6
    assert values["compliance_100ms"] == pytest.approx(expected)
    # published-numbers.md: the static strain at 2.5 kV is 2.46 %
    assert 2.5**2 * values["strain_per_kV2_total"] == pytest.approx(0.0246, abs=5e-5)


def test_only_ratios_are_identified():
    system = Tubular("voigt_kelvin_2", specimen(thickness=Quantity(80e-6, "m", 2e-6)))
    scaled = draws(E_0=6e6, E_1=48e6, E_2=24e6) | {"thickness": np.array([40e-6])}
    time = np.linspace(0.01, 0.5, 9)
    one = system.predict(step(2000.0), time, "strain", draws())
    np.testing.assert_allclose(
        system.predict(step(2000.0), time, "strain", scaled), one, rtol=1e-13
    )
    key = "strain_per_kV2_1"
    assert system.derived(scaled)[key].values == pytest.approx(system.derived(draws())[key].values)


@pytest.mark.parametrize("candidate", ["voigt_kelvin_2", "voigt_kelvin_2_inertia"])
def test_failing_draws_are_nan_rows(candidate):
    values = draws(4) | {"E_1": np.array([12e6, -1.0, 12e6, 12e6])}
    values["tau_2"] = np.array([0.12, 0.12, 0.0, 0.12])
    strain = Tubular(candidate, specimen(**QUANTITIES)).predict(
        step(2000.0), np.linspace(0.1, 0.5, 4), "strain", values
    )
    assert np.isnan(strain).all(axis=1).tolist() == [False, True, True, False]
    assert np.array_equal(strain[0], strain[3])


def test_mistakes_are_named():
    for candidate in ("voigt_kelvin_0", "voigt_kelvin", "kv_gm_2", "voigt_kelvin_2x"):
        with pytest.raises(UserError, match="voigt_kelvin_2"):
            Tubular(candidate, specimen())
    bare = Specimen("tube", "tubular", {}, {"thickness": Quantity(80e-6, "m")})
    with pytest.raises(UserError, match="relative_permittivity"):
        Tubular("voigt_kelvin_1", bare)
    without_length = specimen()
    del without_length.quantities["active_length"]
    system = Tubular("voigt_kelvin_1", without_length)
    time = np.array([0.1])
    with pytest.raises(UserError, match="active_length"):
        system.simulator(step(1.0), time, "displacement")
    with pytest.raises(UserError, match="did you mean 'strain'"):
        system.simulator(step(1.0), time, "strian")
    with pytest.raises(UserError, match="did you mean 'voltage'"):
        system.simulator(Excitation("voltag", "V", time, time), time, "strain")
