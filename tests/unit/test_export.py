"""`deabayes export`: what is asked for is what is written, and what it is worth is said."""

from __future__ import annotations

import json

import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.io import loadmat
from tests.unit.test_predict_with import file

from deabayes.cli import cli
from deabayes.export import export
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree


def test_every_format_holds_the_stored_draws(tmp_path):
    tree = file(None)
    for form in ("csv", "json", "mat"):
        export(tree, form, tmp_path / f"draws.{form}")
    stored = tree["posterior"]["E_0"].values.reshape(-1).tolist()
    assert pd.read_csv(tmp_path / "draws.csv")["E_0 [Pa]"].tolist() == stored
    content = json.loads((tmp_path / "draws.json").read_text())
    assert content["parameters"]["E_0"]["draws"] == stored
    assert loadmat(tmp_path / "draws.mat", squeeze_me=True)["draws"]["E_0"][()].tolist() == stored


@pytest.mark.parametrize(("form", "name"), [("csv", "x.json"), ("json", "x.mat"), ("mat", "x.csv")])
def test_the_ending_of_another_format_is_refused(tmp_path, form, name):
    with pytest.raises(UserError, match=rf"-o .*{name}: --to {form} writes \.{form}"):
        export(file(None), form, tmp_path / name)
    export(file(None), form, tmp_path / "x.txt")


@pytest.mark.parametrize("converged", [True, False])
def test_draws_that_did_not_converge_are_exported_with_a_word(tmp_path, converged):
    tree = file(None)
    tree.attrs["convergence"] = json.dumps({"converged": converged, "reasons": []})
    write_tree(tree, tmp_path / "posterior.nc")
    command = ["export", str(tmp_path / "posterior.nc"), "--to", "csv", "-o"]
    said = CliRunner().invoke(cli, [*command, str(tmp_path / "draws.csv")])
    assert said.exit_code == 0
    assert ("NOT CONVERGED" in said.stderr) is not converged
