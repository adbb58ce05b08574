import datetime

import numpy as np
import pandas as pd
import pytest
from tests.shared.golden import REPOSITORY, golden_table

import deabayes
from deabayes.faults import UserError
from deabayes.records.specimen import read_specimen
from deabayes.systems import REGISTRY, system_class

QUANTITIES = {"thickness": "80 um", "relative_permittivity": 3.1, "active_length": "70 mm"}
VALUES = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
TIME = np.linspace(0.0, 0.5, 6)


def run(parameters=VALUES, specimen=QUANTITIES, **changes):
    settings = {"time": TIME, "voltage": np.full(TIME.size, 2000.0)} | changes
    return deabayes.simulate("tubular", "voigt_kelvin_2", parameters, specimen, **settings)


def test_single_values_give_the_golden_curve_with_units():
    table = golden_table("tubular_creep_compliance", "creep")
    time = table["time"]
    dataset = run(time=time, voltage=np.full(time.size, 2000.0))
    assert dataset.strain.dims == ("time",)
    np.testing.assert_allclose(dataset.strain, table["strain_K2"], rtol=1e-12)
    assert dataset.strain.attrs["units"] == "1"
    assert dataset.time.attrs["units"] == "s"
    assert dataset.voltage.attrs["units"] == "V"
    assert dataset.E_0.attrs["units"] == "Pa"
    assert float(dataset.E_0) == 1.5e6
    assert dataset.attrs["failed_draws"] == 0
    assert dataset.attrs["candidate"] == "voigt_kelvin_2"


def test_draws_broadcast_and_failures_are_counted():
    dataset = run(VALUES | {"E_1": [12e6, -1.0, 24e6]}, response="displacement")
    assert dataset.displacement.shape == (3, TIME.size)
    assert dataset.attrs["failed_draws"] == 1
    assert np.isnan(dataset.displacement[1]).all()
    np.testing.assert_allclose(dataset.displacement[0], 0.07 * run().strain, rtol=1e-13)
    assert dataset.tau_2.values.tolist() == [0.12] * 3


def test_a_row_of_a_table_of_draws_is_taken_by_its_names():
    table = pd.DataFrame([VALUES, VALUES | {"E_0": 3e6}])
    np.testing.assert_array_equal(run(table.iloc[0]).strain, run().strain)
    assert run(table).strain.shape == (2, TIME.size)


def test_a_folder_as_specimen_and_its_uncertain_quantities():
    folder = REPOSITORY / "data" / "tubular"
    np.testing.assert_allclose(run(specimen=folder).strain, run().strain, rtol=1e-12)
    thinner = run(VALUES | {"thickness": 40e-6}, specimen=str(folder))
    np.testing.assert_allclose(thinner.strain, 4 * run().strain, rtol=1e-12)


def test_missing_and_unknown_parameters_are_all_listed():
    wrong = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau2": 0.12, "mu": 1.0}
    with pytest.raises(UserError) as error:
        run(wrong)
    message = str(error.value)
    assert "lacks parameter 'tau_2' [s]" in message
    assert "no parameter 'tau2'; did you mean 'tau_2'?" in message
    assert "no parameter 'mu'" in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": VALUES | {"E_0": [1e6, 2e6], "E_1": [1e6, 2e6, 3e6]}}, "one length"),
        ({"voltage": [1.0, 2.0]}, "differ in length"),
        ({"time": TIME[::-1]}, "must ascend"),
        ({"voltage": np.full(TIME.size, np.nan)}, "finite"),
        ({"stretch": TIME}, "'stretch' is unknown"),
        ({"voltage": [1, 1, np.inf, 1, 1, 1]}, "voltage must be finite, found inf at index 2"),
        ({"time": np.datetime64("2024-05-13") + np.arange(6)}, r"time: .* found dates \(2024"),
        ({"time": [datetime.datetime(2024, 5, 13)] * 6}, r"time: .* found dates \(2024"),
        ({"voltage": np.arange(6).astype("timedelta64[s]")}, "voltage: .* found spans of time"),
        ({"voltage": ["high"] * 6}, "voltage: expected a number and a unit .* found 'high'"),
        ({"voltage": [None] * 6}, "voltage must be finite, found nan at index 0"),
        ({"voltage": [[1, 2], [3]]}, "voltage: rows of unlike length"),
        ({"time": None}, "voltage drives system 'tubular' in time; give time"),
        ({"parameters": VALUES | {"E_0": "1.5 mm"}}, "parameter E_0: unit 'mm' is a length"),
        ({"parameters": VALUES | {"E_0": "1.5e6"}}, "parameter E_0: '1.5e6' has no unit"),
        ({"parameters": VALUES | {"E_0": -1.5e6}}, "E_0 is -1.5e.06 Pa; .* not negative"),
        ({"parameters": VALUES | {"tau_1": np.nan}}, "tau_1 is nan s; it must be finite"),
        ({"conditions": {"laod_g": 300}}, "'laod_g' is unknown .* did you mean 'load_g'"),
        ({"conditions": {"load_kg": 0.3}}, "'load_kg' is unknown .* did you mean 'load_g'"),
        ({"conditions": {"load_g": None}}, "'load_g' must be a finite number .*, found None"),
        ({"conditions": {"load_g": np.inf}}, "'load_g' must be a finite number .*, found inf"),
        ({"conditions": {"load_g": True}}, "'load_g' must be a finite number .*, found True"),
        ({"conditions": {"load_g": "300 g"}}, "'load_g' must be .* without a unit .* '300 g'"),
        ({"conditions": {"load_g": -5}}, "load_g must be a mass in g, zero or more; found -5"),
        ({"specimen": QUANTITIES | {"thickness": {"value": 8e-5}}}, "thickness: 'unit' is missing"),
        ({"specimen": QUANTITIES | {"thickness": {"unit": "m"}}}, "thickness: 'value' is missing"),
        ({"response": "strian"}, "did you mean 'strain'"),
        ({"conditions": [300]}, r"conditions: give names with values.*found \[300\]"),
        ({"parameters": [1.5e6, 12e6]}, r"parameters: give names with values.*found \[1500000"),
        ({"time": [], "voltage": []}, "time holds no values"),
        ({"specimen": None}, "specimen: give a study folder or a mapping .* found None"),
        ({"specimen": __file__}, r"test_simulation.py: is a file; name its folder .*systems$"),
        ({"specimen": {"thickness": "80 um"}}, "relative_permittivity"),
        ({"specimen": QUANTITIES | {"thickness": "80 V"}}, "thickness"),
    ],
)
def test_mistakes_are_user_errors(changes, message):
    with pytest.raises(UserError, match=message):
        run(**changes)


def test_spans_of_time_units_and_numbers_of_numpy_are_taken():
    expected = run().strain
    spans = TIME * 1e6 * np.timedelta64(1, "us")
    for time in (spans, list(spans.astype(object)), pd.Series(spans)):
        np.testing.assert_allclose(run(time=time).strain, expected, rtol=1e-12)
    np.testing.assert_allclose(run(voltage=["2 kV"] * 6).strain, expected, rtol=1e-12)
    written = VALUES | {"E_0": "1.5 MPa", "tau_1": "6 ms", "E_1": np.float32(12e6)}
    np.testing.assert_allclose(run(written).strain, expected, rtol=1e-12)
    mapping = {"value": np.int64(80), "unit": "um", "sd": None}
    for thickness in (mapping, np.float64(80e-6), np.array(80e-6)[()]):
        specimen = QUANTITIES | {"thickness": thickness}
        np.testing.assert_allclose(run(specimen=specimen).strain, expected, rtol=1e-12)
    rounded = QUANTITIES | {"relative_permittivity": np.float32(3.1)}
    np.testing.assert_allclose(run(specimen=rounded).strain, expected, rtol=1e-6)


@pytest.mark.parametrize("system", REGISTRY)
def test_every_system_says_which_conditions_it_reads(system):
    assert system_class(system).conditions is not None


def test_a_hung_mass_is_a_condition_that_is_read():
    folder = REPOSITORY / "data" / "tubular"
    mass = {"moving_mass": 0.05, "cross_section": 6e-5}
    known = deabayes.systems.build("tubular", "voigt_kelvin_2_inertia", read_specimen(folder))
    values = VALUES | {p.name: mass[p.name] for p in known.parameters() if p.name in mass}
    arguments = ("tubular", "voigt_kelvin_2_inertia", values, folder)
    drive = {"time": TIME, "voltage": np.full(TIME.size, 2000.0)}
    light = deabayes.simulate(*arguments, **drive)
    heavy = deabayes.simulate(*arguments, **drive, conditions={"load_g": 3000})
    assert not np.allclose(light.strain, heavy.strain)


def test_an_excitation_is_needed_and_the_system_must_be_the_folders():
    arguments = ("voigt_kelvin_2", VALUES)
    with pytest.raises(UserError, match="exactly one excitation"):
        deabayes.simulate("tubular", *arguments, specimen=QUANTITIES, time=TIME)
    with pytest.raises(UserError, match="did you mean 'tubular'"):
        deabayes.simulate("tubulr", *arguments, specimen=QUANTITIES, time=TIME, voltage=TIME)
    folder = REPOSITORY / "data" / "tubular"
    with pytest.raises(UserError, match="'tubular', not 'tensile_strip'"):
        deabayes.simulate("tensile_strip", "gent", {}, specimen=folder, stretch=TIME)


def test_a_quasi_static_excitation_is_its_own_coordinate():
    stretch = np.array([1.0, 1.5, 2.0])
    dataset = deabayes.simulate(
        "tensile_strip", "neo_hookean", {"mu": 3e4}, specimen={}, stretch=stretch
    )
    assert dataset.nominal_stress.dims == ("stretch",)
    expected = 3e4 * (stretch - stretch**-2)
    np.testing.assert_allclose(dataset.nominal_stress, expected, rtol=1e-12, atol=1e-9)
    assert dataset.stretch.attrs["units"] == "1"


@pytest.mark.parametrize(
    ("system", "candidate", "parameters", "drive"),
    [
        ("tubular", "voigt_kelvin_2", VALUES, {"frequency": np.linspace(1.0, 100.0, 6)}),
        (
            "minimum_energy_structure", "ogden_1", {"mu_1": 3e4, "alpha_1": 2.0},
            {"displacement": np.linspace(0.0, 3e-3, 6)},
        ),
    ],
)  # fmt: skip
def test_a_steady_state_is_at_no_time(system, candidate, parameters, drive):
    """Times were taken for frequencies, and for displacements, without a word."""
    (name,) = drive
    with pytest.raises(UserError, match=f"^{name} moves system '{system}' through .* leave time"):
        deabayes.simulate(
            system, candidate, parameters, REPOSITORY / "data" / system, time=TIME, **drive
        )


@pytest.mark.parametrize("voltage", [[0.0], [0.0, 1.0, 2.0]])
def test_a_voltage_of_one_volt_per_second_is_in_time(voltage):
    quantities = {"thickness": "1 mm", "permittivity": 4e-11, "prestretch": 1.2}
    draws = {"mu_alpha": 4e4, "zeta_alpha": 1e3, "J_alpha": 100.0, "mu_beta_1": 2e4,
             "tau_beta_1": 10.0, "J_beta": 100.0}  # fmt: skip
    found = deabayes.simulate(
        "membrane", "kv_gm_1", draws, quantities, time=voltage, voltage=voltage
    )
    np.testing.assert_allclose(found.stretch, 1.2, rtol=1e-6)


def test_a_strip_pulled_at_one_per_second_relaxes():
    draws = {"mu": 3e4, "mu_beta_1": 2e4, "tau_1": 1.0}
    pulled = np.array([1.0, 2.0, 3.0])
    run = ("tensile_strip", "neo_hookean_units_1", draws, {})
    found = deabayes.simulate(*run, time=pulled, stretch=pulled)
    later = deabayes.simulate(*run, time=pulled + 5.0, stretch=pulled)
    np.testing.assert_allclose(found.nominal_stress, later.nominal_stress, rtol=1e-12)
    with pytest.raises(UserError, match="needs time"):
        deabayes.simulate(*run, stretch=pulled)


TERMS = {"mu_1": 0.63e6, "alpha_1": 1.3, "mu_2": -9.8e3, "alpha_2": -2.0}
PULL = {"specimen": {}, "stretch": [1.0, 1.5, 2.0]}


def test_a_term_of_negative_coefficient_and_exponent_is_taken():
    single = deabayes.simulate("tensile_strip", "ogden_2", TERMS, **PULL)
    drawn = {name: [value] for name, value in TERMS.items()}
    array = deabayes.simulate("tensile_strip", "ogden_2", drawn, **PULL)
    np.testing.assert_array_equal(single.nominal_stress, array.nominal_stress[0])
    assert single.nominal_stress[1] > 0.0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"alpha_2": 2.0}, "mu_2 is -9800 Pa and alpha_2 is 2; both must have the same sign"),
        ({"mu_1": [-1e6]}, r"mu_1 is -1e\+06 Pa and alpha_1 is 1.3 in draw 0; both must"),
        ({"alpha_2": [-2.0, 3.0]}, "mu_2 is -9800 Pa and alpha_2 is 3 in draw 1"),
        ({"mu_2": np.nan}, "mu_2 is nan Pa; it must be finite"),
    ],
)
def test_a_term_of_opposed_signs_is_refused(changed, said):
    with pytest.raises(UserError, match=said):
        deabayes.simulate("tensile_strip", "ogden_2", TERMS | changed, **PULL)
