"""`deabayes export`: what is asked for is what is written, and what it is worth is said."""

from __future__ import annotations

import json

import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.io import loadmat
from tests.posteriors.test_predict_with import file

from deabayes.cli.main import cli
from deabayes.cli.using import FORMATS
from deabayes.export import ENDINGS, REGISTRY, export
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree


def test_every_format_holds_the_stored_draws(tmp_path):
    tree = file(None)
    for form in ("csv", "parquet", "json", "mat"):
        export(tree, form, tmp_path / f"draws.{form}")
    stored = tree["posterior"]["E_0"].values.reshape(-1).tolist()
    assert pd.read_csv(tmp_path / "draws.csv")["E_0 [Pa]"].tolist() == stored
    assert pd.read_parquet(tmp_path / "draws.parquet")["E_0"].tolist() == stored
    content = json.loads((tmp_path / "draws.json").read_text())
    assert content["parameters"]["E_0"]["draws"] == stored
    assert loadmat(tmp_path / "draws.mat", squeeze_me=True)["draws"]["E_0"][()].tolist() == stored


@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("csv", "x.json"),
        ("json", "x.mat"),
        ("mat", "x.csv"),
        ("parquet", "x.csv"),
        ("csv", "x.inp"),
        ("csv", "x.xlsx"),
        ("mat", "x.NC"),
    ],
)
def test_the_ending_of_another_format_is_refused(tmp_path, form, name):
    with pytest.raises(UserError, match=rf"-o .*{name}: --to {form} writes \.{form}"):
        export(file(None), form, tmp_path / name)
    export(file(None), form, tmp_path / "x.txt")


def test_no_format_is_proposed_that_is_hardly_alike(tmp_path):
    with pytest.raises(UserError, match="--to 'ss' is no export format; known: abaqus, "):
        export(file(None), "ss", tmp_path / "x")


@pytest.mark.parametrize("converged", [True, False])
def test_draws_that_did_not_converge_are_exported_with_a_word(tmp_path, converged):
    tree = file(None)
    tree.attrs["convergence"] = json.dumps({"converged": converged, "reasons": []})
    write_tree(tree, tmp_path / "posterior.nc")
    command = ["export", str(tmp_path / "posterior.nc"), "--to", "csv", "-o"]
    said = CliRunner().invoke(cli, [*command, str(tmp_path / "draws.csv")])
    assert said.exit_code == 0
    assert ("NOT CONVERGED" in said.stderr) is not converged


def test_every_format_is_named_by_the_help_and_completed_by_shells():
    assert list(FORMATS) == list(REGISTRY) and set(ENDINGS) | {"state-space"} == set(REGISTRY)
    said = " ".join(CliRunner().invoke(cli, ["export", "--help"]).output.split())
    assert f"One of {', '.join(REGISTRY)}." in said
    words = {"COMP_WORDS": "deabayes export x.nc --to a", "COMP_CWORD": "4"}
    shell = CliRunner().invoke(
        cli, [], prog_name="deabayes", env=words | {"_DEABAYES_COMPLETE": "bash_complete"}
    )
    assert shell.output.split() == ["plain,abaqus", "plain,ansys"]
