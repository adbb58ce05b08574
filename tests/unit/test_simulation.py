import numpy as np
import pytest
from tests.unit.golden import REPOSITORY, golden_table

import deabayes
from deabayes.faults import UserError

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
        ({"response": "strian"}, "did you mean 'strain'"),
        ({"specimen": {"thickness": "80 um"}}, "relative_permittivity"),
        ({"specimen": QUANTITIES | {"thickness": "80 V"}}, "thickness"),
    ],
)
def test_mistakes_are_user_errors(changes, message):
    with pytest.raises(UserError, match=message):
        run(**changes)


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
