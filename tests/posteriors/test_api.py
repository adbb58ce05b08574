"""What somebody types who has a posterior file and a Python prompt."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.posteriors.test_predict_with import file

import deabayes
from deabayes.api import Posterior, open_posterior
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree
from deabayes.units import registry

TIME = np.linspace(0.0, 0.5, 6)
VOLTS = np.linspace(1000.0, 2000.0, 6)


@pytest.fixture(scope="module")
def post():
    return Posterior(file(None))


def median(post, **channels):
    return post.predict(size=50, **channels)["median"].values


@pytest.mark.filterwarnings("error")
def test_units_that_values_carry_count(post):
    expected = median(post, time=TIME, voltage=VOLTS)
    quantity = registry().Quantity
    array = xr.DataArray(VOLTS / 1e3, dims="time", attrs={"units": "kV"})
    for time, voltage in (
        (quantity(TIME * 1e3, "ms"), quantity(VOLTS / 1e3, "kV")),
        (TIME, [quantity(each / 1e3, "kV") for each in VOLTS]),
        (pd.Series(TIME * 1e3, name="time [ms]"), pd.Series(VOLTS / 1e3, name="voltage [kV]")),
        (pd.Series(TIME, name="time"), array),
    ):
        np.testing.assert_allclose(median(post, time=time, voltage=voltage), expected, rtol=1e-12)


def test_a_carried_unit_of_another_dimension_is_refused(post):
    with pytest.raises(UserError, match="voltage: unit 'mm' is a length, expected a voltage"):
        post.predict(time=TIME, voltage=pd.Series(VOLTS, name="voltage [mm]"))


@pytest.mark.parametrize("held", [1800.0, "1.8 kV", np.float64(1800.0)])
def test_one_value_is_held_over_the_time(post, held):
    expected = median(post, time=TIME, voltage=np.full(TIME.size, 1800.0))
    np.testing.assert_array_equal(median(post, time=TIME, voltage=held), expected)


@pytest.mark.parametrize(
    ("voltage", "note", "said"),
    [
        (9e3, "extrapolation", "extrapolation: voltage 9000 to 9000 V lies outside the calibrated"),
        (1.8, "unit_note", r"reaches only 1\.8 V, .* in kV, give its unit \(.1\.8 kV.\)$"),
    ],
)
def test_a_reason_not_to_trust_a_prediction_is_a_warning_and_an_attribute(
    post, voltage, note, said
):
    with pytest.warns(deabayes.PredictionWarning, match=said) as caught:
        found = post.predict(size=20, time=TIME, voltage=voltage)
    (caution,) = caught
    assert found.attrs[note] and str(caution.message).endswith(found.attrs[note])
    assert caution.filename == __file__, "it points at the user's line"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("voltage", [1800.0, "1.8 kV", 0.0])
def test_a_prediction_within_the_calibration_warns_of_nothing(post, voltage):
    found = post.predict(size=20, time=TIME, voltage=voltage)
    assert found.attrs["unit_note"] == found.attrs["extrapolation"] == ""


def test_draws_that_did_not_converge_are_warned_of():
    tree = file(None)
    tree.attrs["convergence"] = json.dumps({"converged": False, "reasons": []})
    with pytest.warns(deabayes.PredictionWarning, match="NOT CONVERGED"):
        Posterior(tree).predict(size=20, time=TIME, voltage=VOLTS)


def test_a_function_as_excitation_is_refused_with_a_remedy(post):
    with pytest.raises(UserError, match=r"voltage: .* found a function; give its values"):
        post.predict(time=TIME, voltage=lambda time: 1800.0 * time)


def test_draws_without_a_size_are_all_in_their_order(post):
    drawn = post.draws()
    assert len(drawn) == 600
    stored = post.data["posterior"]["E_0"].values.reshape(-1)
    np.testing.assert_array_equal(drawn["E_0"], stored)


def test_another_seed_picks_other_draws(post):
    first, same, other = (post.draws(50, seed=seed)["E_0"] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert set(first) != set(other)


@pytest.mark.parametrize("size", [0, -1, 2.5, "many"])
def test_an_impossible_number_of_draws_is_refused(post, size):
    for ask in (post.draws, lambda size: post.predict(time=TIME, voltage=VOLTS, size=size)):
        with pytest.raises(UserError, match=f"size must be a whole number above 0, found {size!r}"):
            ask(size)


@pytest.mark.parametrize("seed", [-1, "one", 1.5])
def test_an_impossible_seed_is_refused(post, seed):
    for ask in (post.draws, lambda size, seed: post.predict(time=TIME, voltage=VOLTS, seed=seed)):
        with pytest.raises(UserError, match=f"seed must be a whole number, 0 or more; .*{seed}"):
            ask(5, seed=seed)


def test_a_frequency_that_is_not_positive_is_refused(post):
    with pytest.raises(UserError, match="frequency must be positive, found -1 Hz"):
        post.predict(frequency=[-1.0, 1.0], response="gain", conditions={"bias_kV": 2})


def test_a_posterior_that_did_not_converge_says_so_when_printed(post):
    tree = file(None)
    tree["summary"] = xr.DataTree(tree["summary"].to_dataset().assign(converged=("quantity", [
        False, *[True] * (tree["summary"].sizes["quantity"] - 1)
    ])))  # fmt: skip
    assert "NOT CONVERGED" in repr(Posterior(tree))
    tree["summary"]["converged"][:] = True
    assert "CONVERGED" not in repr(Posterior(tree))


def test_a_prior_is_printed_in_one_line(post):
    assert repr(post.as_prior()) == "<Prior from 600 draws of E_0, E_1, E_2, tau_1, tau_2>"


def test_a_folder_is_refused_with_the_posteriors_in_it(tmp_path):
    (tmp_path / "study" / "kv_gm_1").mkdir(parents=True)
    with pytest.raises(UserError, match=r"study: is a folder without a posterior\.nc"):
        open_posterior(tmp_path / "study")
    (tmp_path / "study" / "kv_gm_1" / "posterior.nc").touch()
    with pytest.raises(UserError, match=r"study: is a folder; give .*kv_gm_1/posterior\.nc"):
        open_posterior(tmp_path / "study")


def lacking(tree, group):
    return xr.DataTree.from_dict(
        {name: child.to_dataset() for name, child in tree.children.items() if name != group}
    )


def test_another_programs_posterior_is_refused_when_opened(tmp_path):
    path = tmp_path / "posterior.nc"
    given = file(None)
    write_tree(lacking(given, "summary"), path)
    with pytest.raises(
        UserError, match=r"posterior\.nc: holds no group summary, attribute study, "
    ):
        open_posterior(path)
    given.attrs.pop("noise")
    write_tree(given, path)
    with pytest.raises(
        UserError, match=r"holds no attribute noise; give a posterior\.nc written by"
    ):
        open_posterior(path)


def test_the_file_of_another_version_names_both(tmp_path):
    path = tmp_path / "posterior.nc"
    both = rf"deabayes {deabayes.__version__} cannot read .* by deabayes 9\.1: use that version"

    def told(change):
        tree = file(None)
        tree.attrs["deabayes_version"] = "9.1"
        change(tree.attrs)
        write_tree(tree, path)
        with pytest.raises(UserError, match=both) as caught:
            open_posterior(path).predict(time=TIME, voltage=VOLTS)
        return str(caught.value)

    def record(attributes):
        kept = json.loads(attributes["experiments"])
        attributes["experiments"] = json.dumps([each | {"future": 1} for each in kept])

    def specimen(attributes):
        kept = json.loads(attributes["specimen"])
        kept["quantities"]["thickness"]["future"] = 1
        attributes["specimen"] = json.dumps(kept)

    assert "the noise model (cauchy)" in told(lambda attributes: attributes.update(noise="cauchy"))
    assert "unexpected keyword argument 'future'" in told(record)
    assert "unexpected keyword argument 'future'" in told(specimen)


def test_the_package_lists_what_it_offers_and_has_types():
    names = ["Posterior", "PredictionWarning", "UserError", "__version__", "load_models",
             "open_posterior", "simulate"]  # fmt: skip
    assert dir(deabayes) == names and all(hasattr(deabayes, name) for name in names)
    assert Path(deabayes.__file__).with_name("py.typed").is_file()


def test_draws_of_some_kinds_are_what_simulate_takes(post):
    drawn = post.draws(5, kinds=("material", "specimen"))
    everything = post.draws(5)
    assert set(drawn) < set(everything) and not [name for name in drawn if "." in name]
    pd.testing.assert_frame_equal(drawn, everything[list(drawn)])
    specimen = {
        n: q["value"] for n, q in json.loads(post.data.attrs["specimen"])["quantities"].items()
    }
    found = deabayes.simulate(
        "tubular", post.data.attrs["candidate"], drawn, specimen, time=TIME, voltage=VOLTS
    )
    assert found.sizes["draw"] == 5
    assert list(post.draws(5, kinds="noise")) == [n for n in everything if "." in n]
    for wrong in (("material", "specimin"), "specimin"):
        with pytest.raises(UserError, match=r"^kinds: specimin; the posterior has material, "):
            post.draws(kinds=wrong)
    with pytest.raises(UserError, match=r"^kinds: none; the posterior has"):
        post.draws(kinds=())
