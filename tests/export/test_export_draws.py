"""Draws in the formats of other programs: every number under its name, with its unit."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import scipy.io
import xarray as xr

from deabayes.export import export
from deabayes.export.source import draws_table
from deabayes.faults import UserError

LONG = "a_record_of_a_whole_week_in_may.sigma_white"
NAMES = {
    "mu_alpha": ("Pa", "material"),
    "quasi_static.sigma_ou": ("N", "noise"),
    "2kV-step.sigma_ou": ("m", "noise"),
    LONG: ("m", "noise"),
}


def tree(names=NAMES):
    """Two ensembles of three draws; draw k of ensemble e of quantity q is 100 q + 10 e + k."""
    draws = {
        name: (("chain", "draw"), 100.0 * q + np.add.outer([0.0, 10.0], np.arange(3.0)),
               {"unit": unit, "symbol": f"s_{q}", "kind": kind})
        for q, (name, (unit, kind)) in enumerate(names.items())
    }  # fmt: skip
    found = xr.DataTree.from_dict({"posterior": xr.Dataset(draws)})
    found.attrs.update(
        candidate="kv_gm_1", system="membrane", provenance="simulated", deabayes_version="1",
        convergence=json.dumps({"converged": False}),
    )  # fmt: skip
    return found


ENSEMBLE = [0, 0, 0, 1, 1, 1]
FIRST = [0.0, 1.0, 2.0, 10.0, 11.0, 12.0]


def test_the_table_has_one_ensemble_after_the_other():
    table = draws_table(tree(), ("noise",))
    assert list(table.columns) == ["ensemble", *list(NAMES)[1:]]
    assert table["ensemble"].tolist() == ENSEMBLE
    assert table[LONG].tolist() == [300.0 + each for each in FIRST]


def test_csv_says_the_unit_of_every_column(tmp_path):
    export(tree(), "csv", tmp_path / "draws.csv")
    table = pd.read_csv(tmp_path / "draws.csv")
    assert list(table.columns)[:3] == ["ensemble", "mu_alpha [Pa]", "quasi_static.sigma_ou [N]"]
    assert table["mu_alpha [Pa]"].tolist() == FIRST


@pytest.mark.parametrize(
    ("provenance", "converged", "told"),
    [("simulated", False, (1, 0)), ("measured", True, (0, 1)), ("digitised", False, (0, 0))],
)
def test_csv_and_matlab_say_what_the_draws_are_worth(tmp_path, provenance, converged, told):
    """In columns behind the others, of numbers alone: no reader of plain tables is at a loss."""
    found = tree()
    found.attrs.update(provenance=provenance, convergence=json.dumps({"converged": converged}))
    export(found, "csv", tmp_path / "draws.csv")
    table = pd.read_csv(tmp_path / "draws.csv")
    assert list(table.columns)[-2:] == ["simulated", "converged"]
    assert np.loadtxt(tmp_path / "draws.csv", delimiter=",", skiprows=1).shape == table.shape
    assert set(zip(table["simulated"], table["converged"], strict=True)) == {told}
    export(found, "mat", tmp_path / "draws.mat")
    about = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)["about"]
    assert about == {
        "candidate": "kv_gm_1", "system": "membrane", "provenance": provenance,
        "deabayes_version": "1", "converged": converged,
    }  # fmt: skip


def test_parquet_keeps_plain_names_and_says_units_in_its_metadata(tmp_path):
    export(tree(), "parquet", tmp_path / "draws.parquet")
    table = pd.read_parquet(tmp_path / "draws.parquet")
    assert list(table.columns) == ["ensemble", *NAMES]
    assert table["ensemble"].tolist() == ENSEMBLE and table["mu_alpha"].tolist() == FIRST
    schema = pq.read_schema(tmp_path / "draws.parquet")
    assert schema.field("ensemble").metadata is None
    for q, (name, (unit, _)) in enumerate(NAMES.items()):
        told = schema.field(name).metadata
        assert (told[b"unit"], told[b"symbol"]) == (unit.encode(), f"s_{q}".encode())
    told = {key: schema.metadata[key].decode() for key in schema.metadata if key != b"pandas"}
    assert told == {
        b"candidate": "kv_gm_1", b"system": "membrane", b"provenance": "simulated",
        b"converged": "false", b"deabayes_version": "1",
    }  # fmt: skip


def test_json_says_what_the_draws_are_of(tmp_path):
    export(tree(), "json", tmp_path / "draws.json")
    found = json.loads((tmp_path / "draws.json").read_text(encoding="utf-8"))
    assert found["ensemble"] == ENSEMBLE and found["converged"] is False
    assert found["parameters"]["mu_alpha"] == {
        "unit": "Pa", "symbol": "s_0", "kind": "material", "draws": FIRST,
    }  # fmt: skip


def test_json_of_draws_that_are_not_finite_is_json(tmp_path):
    found = tree()
    found["posterior"]["mu_alpha"][0] = [np.nan, np.inf, -np.inf]
    export(found, "json", tmp_path / "draws.json")

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    text = (tmp_path / "draws.json").read_text(encoding="utf-8")
    told = json.loads(text, parse_constant=refuse)["parameters"]["mu_alpha"]["draws"]
    assert told == [None, None, None, *FIRST[3:]]


def test_matlab_gets_every_quantity_whatever_its_name(tmp_path):
    """savemat drops a field that begins with a digit, and refuses one of 32 letters and more."""
    export(tree(), "mat", tmp_path / "draws.mat")
    found = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)
    fields = ["mu_alpha", "quasi_static__sigma_ou", "x2kV_step__sigma_ou",
              LONG.replace(".", "__")]  # fmt: skip
    assert list(found["draws"]) == ["ensemble", *fields]
    assert found["units"] == dict(zip(fields, ["Pa", "N", "m", "m"], strict=True))
    for q, name in enumerate(fields):
        np.testing.assert_array_equal(found["draws"][name], 100.0 * q + np.array(FIRST))


def test_names_that_differ_in_a_sign_only_stay_two_quantities_in_matlab(tmp_path):
    names = ["step_-2kV.tau_ou", "step__2kV.tau_ou", "step_.2kV.tau_ou", "step___2kV__tau_ou"]
    export(tree(dict.fromkeys(names, ("s", "noise"))), "mat", tmp_path / "draws.mat")
    found = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)
    fields = ["step__2kV__tau_ou", "step__2kV__tau_ou_1", "step___2kV__tau_ou",
              "step___2kV__tau_ou_1"]  # fmt: skip
    assert found["names"] == dict(zip(["ensemble", *fields], ["ensemble", *names], strict=True))
    for q, name in enumerate(fields):
        np.testing.assert_array_equal(found["draws"][name], 100.0 * q + np.array(FIRST))


def test_a_name_that_matlab_does_not_allow_is_said(tmp_path):
    long = tree({f"{'a' * 60}.tau_ou": ("s", "noise")})
    with pytest.raises(UserError, match=r"63 characters .* csv or json"):
        export(long, "mat", tmp_path / "draws.mat")
    assert not list(tmp_path.iterdir())
