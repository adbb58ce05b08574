"""Draws as csv, parquet, json and mat, and the command `deabayes export`."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import scipy.io
import xarray as xr
from click.testing import CliRunner
from tests.posteriors.test_predict_with import file

from deabayes.cli.main import cli
from deabayes.export import REGISTRY, export
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree

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


def test_csv_names_columns_with_units_and_lists_one_ensemble_after_the_other(tmp_path):
    export(tree(), "csv", tmp_path / "draws.csv")
    table = pd.read_csv(tmp_path / "draws.csv")
    assert list(table.columns)[:3] == ["ensemble", "mu_alpha [Pa]", "quasi_static.sigma_ou [N]"]
    assert table["ensemble"].tolist() == ENSEMBLE
    assert table["mu_alpha [Pa]"].tolist() == FIRST
    assert table[f"{LONG} [m]"].tolist() == [300.0 + value for value in FIRST]


@pytest.mark.parametrize(
    ("provenance", "converged", "flags"),
    [("simulated", False, (1, 0)), ("measured", True, (0, 1)), ("digitised", False, (0, 0))],
)
def test_csv_and_matlab_flag_simulated_and_unconverged_draws(
    tmp_path, provenance, converged, flags
):
    """In csv as last columns that hold only numbers, which every reader of tables accepts."""
    found = tree()
    found.attrs.update(provenance=provenance, convergence=json.dumps({"converged": converged}))
    export(found, "csv", tmp_path / "draws.csv")
    table = pd.read_csv(tmp_path / "draws.csv")
    assert list(table.columns)[-2:] == ["simulated", "converged"]
    assert np.loadtxt(tmp_path / "draws.csv", delimiter=",", skiprows=1).shape == table.shape
    assert set(zip(table["simulated"], table["converged"], strict=True)) == {flags}
    export(found, "mat", tmp_path / "draws.mat")
    about = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)["about"]
    assert about == {
        "candidate": "kv_gm_1", "system": "membrane", "provenance": provenance,
        "deabayes_version": "1", "converged": converged,
    }  # fmt: skip


def test_parquet_keeps_plain_names_and_has_units_as_metadata(tmp_path):
    export(tree(), "parquet", tmp_path / "draws.parquet")
    table = pd.read_parquet(tmp_path / "draws.parquet")
    assert list(table.columns) == ["ensemble", *NAMES]
    assert table["ensemble"].tolist() == ENSEMBLE and table["mu_alpha"].tolist() == FIRST
    schema = pq.read_schema(tmp_path / "draws.parquet")
    assert schema.field("ensemble").metadata is None
    for q, (name, (unit, _)) in enumerate(NAMES.items()):
        metadata = schema.field(name).metadata
        assert (metadata[b"unit"], metadata[b"symbol"]) == (unit.encode(), f"s_{q}".encode())
    told = {key: schema.metadata[key].decode() for key in schema.metadata if key != b"pandas"}
    assert told == {
        b"candidate": "kv_gm_1", b"system": "membrane", b"provenance": "simulated",
        b"converged": "false", b"deabayes_version": "1",
    }  # fmt: skip


def test_json_holds_units_and_replaces_numbers_that_are_not_finite(tmp_path):
    found = tree()
    found["posterior"]["quasi_static.sigma_ou"][0] = [np.nan, np.inf, -np.inf]
    export(found, "json", tmp_path / "draws.json")

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    text = (tmp_path / "draws.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=refuse)
    assert content["ensemble"] == ENSEMBLE and content["converged"] is False
    assert content["parameters"]["mu_alpha"] == {
        "unit": "Pa", "symbol": "s_0", "kind": "material", "draws": FIRST,
    }  # fmt: skip
    draws = content["parameters"]["quasi_static.sigma_ou"]["draws"]
    assert draws == [None, None, None, *(100.0 + value for value in FIRST[3:])]


def test_matlab_gets_every_quantity_under_an_allowed_name(tmp_path):
    """savemat drops a field that begins with a digit, and refuses one of 32 letters and more."""
    export(tree(), "mat", tmp_path / "draws.mat")
    found = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)
    fields = ["mu_alpha", "quasi_static__sigma_ou", "x2kV_step__sigma_ou",
              LONG.replace(".", "__")]  # fmt: skip
    assert list(found["draws"]) == ["ensemble", *fields]
    assert found["units"] == dict(zip(fields, ["Pa", "N", "m", "m"], strict=True))
    for q, name in enumerate(fields):
        np.testing.assert_array_equal(found["draws"][name], 100.0 * q + np.array(FIRST))


def test_names_that_become_the_same_field_stay_apart_in_matlab(tmp_path):
    names = ["step_-2kV.tau_ou", "step__2kV.tau_ou", "step_.2kV.tau_ou", "step___2kV__tau_ou"]
    export(tree(dict.fromkeys(names, ("s", "noise"))), "mat", tmp_path / "draws.mat")
    found = scipy.io.loadmat(tmp_path / "draws.mat", simplify_cells=True)
    fields = ["step__2kV__tau_ou", "step__2kV__tau_ou_1", "step___2kV__tau_ou",
              "step___2kV__tau_ou_1"]  # fmt: skip
    assert found["names"] == dict(zip(["ensemble", *fields], ["ensemble", *names], strict=True))
    for q, name in enumerate(fields):
        np.testing.assert_array_equal(found["draws"][name], 100.0 * q + np.array(FIRST))


def test_a_name_too_long_for_matlab_is_refused(tmp_path):
    long = tree({f"{'a' * 60}.tau_ou": ("s", "noise")})
    with pytest.raises(UserError, match=r"at most 63 characters; export with --to csv or --to j"):
        export(long, "mat", tmp_path / "draws.mat")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("csv", "x.json"),
        ("json", "x.mat"),
        ("mat", "x.csv"),
        ("csv", "x.inp"),
        ("csv", "x.xlsx"),
        ("mat", "x.NC"),
    ],
)
def test_the_ending_of_another_format_is_refused(tmp_path, form, name):
    with pytest.raises(UserError, match=rf"-o .*{name}: --to {form} writes \.{form} files"):
        export(tree(), form, tmp_path / name)
    export(tree(), form, tmp_path / "x.txt")


def test_an_unknown_format_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(UserError, match="--to 'ss' is no export format; known: abaqus, "):
        export(tree(), "ss", tmp_path / "x")


@pytest.mark.parametrize("converged", [True, False])
def test_the_command_warns_of_draws_that_did_not_converge(tmp_path, converged):
    posterior = file(None)
    posterior.attrs["convergence"] = json.dumps({"converged": converged, "reasons": []})
    write_tree(posterior, tmp_path / "posterior.nc")
    command = ["export", str(tmp_path / "posterior.nc"), "--to", "csv", "-o"]
    result = CliRunner().invoke(cli, [*command, str(tmp_path / "draws.csv")])
    assert result.exit_code == 0
    assert ("NOT CONVERGED" in result.stderr) is not converged
    stored = posterior["posterior"]["E_0"].values.reshape(-1).tolist()
    assert pd.read_csv(tmp_path / "draws.csv")["E_0 [Pa]"].tolist() == stored


@pytest.mark.parametrize("name", ["tube", "tube/one"])
def test_the_command_takes_a_study_or_a_candidate_by_name(tmp_path, name):
    posterior = tmp_path / "results/tube/one/posterior.nc"
    posterior.parent.mkdir(parents=True)
    write_tree(file(None), posterior)
    stored = []
    for source in (name, str(posterior)):
        command = ["export", source, "--results", str(tmp_path / "results"), "--to", "csv", "-o"]
        result = CliRunner().invoke(cli, [*command, str(tmp_path / "draws.csv")])
        assert result.exit_code == 0, result.stderr
        stored.append((tmp_path / "draws.csv").read_text())
    assert stored[0] == stored[1]


def test_the_help_names_every_format_and_shells_complete_them():
    text = " ".join(CliRunner().invoke(cli, ["export", "--help"]).output.split())
    assert f"One of {', '.join(REGISTRY)}." in text
    words = {"COMP_WORDS": "deabayes export x.nc --to a", "COMP_CWORD": "4"}
    shell = CliRunner().invoke(
        cli, [], prog_name="deabayes", env=words | {"_DEABAYES_COMPLETE": "bash_complete"}
    )
    assert shell.output.split() == ["plain,abaqus", "plain,ansys"]
