"""What the export of matrices refuses, what it warns of, and its command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from tests.shared import membranes
from tests.shared.fake_tables import whole
from tests.shared.tube_trees import tree

from deabayes.cli.main import cli
from deabayes.experiment import Specimen
from deabayes.export import export
from deabayes.faults import UserError
from deabayes.posteriors.storage import write_tree

STRIP = Specimen("strip", "tensile_strip", {}, {})


def exported(posterior, folder, **options):
    export(posterior, "state-space", folder / "model.json", **options)
    return json.loads((folder / "model.json").read_text())


@pytest.mark.parametrize(
    ("candidate", "name", "options", "words"),
    [
        ("voigt_kelvin_2", "m.csv", {}, "writes .json or .mat, by the ending of -o; found '.csv'"),
        ("voigt_kelvin_2", "m", {}, "found 'no ending'"),
        ("voigt_kelvin_2", "m.json", {"rate": "10"}, "--rate: '10' has no unit"),
        ("voigt_kelvin_2", "m.json", {"rate": "10 ms"}, "--rate: unit 'ms' is a time"),
        ("voigt_kelvin_2", "m.json", {"rate": "0 Hz"}, "--rate must be more than zero"),
        ("voigt_kelvin_2", "m.json", {"bias": "-2 kV"}, "--bias must be more than zero"),
        ("voigt_kelvin_2", "m.json", {"draws": 13}, "--draws 13: the posterior holds 12 draws"),
        ("voigt_kelvin_2_inertia", "m.json", {"load_g": -1.0}, "--load-g must be a mass in g"),
        ("voigt_kelvin_2", "m.json", {"load_g": 5.0}, "has no mass, so no load can hang from it"),
    ],
)
def test_what_cannot_be_is_said(candidate, name, options, words, tmp_path):
    with pytest.raises(UserError) as caught:
        export(tree(candidate), "state-space", tmp_path / name, **options)
    assert words in str(caught.value) and list(tmp_path.iterdir()) == []


def test_draws_without_finite_matrices_are_refused(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia")
    posterior["posterior"]["tau_1"].values[0, 2] = 0.0
    with pytest.raises(UserError, match="1 of 12 draws have no state space"):
        exported(posterior, tmp_path)


@pytest.mark.parametrize("other", [STRIP, membranes.PLAIN], ids=lambda other: other.system)
def test_a_system_that_is_not_linear_has_no_state_space(other, tmp_path):
    words = f"kv_gm_1 of system .{other.system}. has no linear model of a motion, so there is no"
    with pytest.raises(UserError, match=words):
        exported(tree("kv_gm_1", of=other), tmp_path)


@pytest.mark.parametrize("to", ["csv", "json", "mat"])
@pytest.mark.parametrize("option", ["--rate=1 kHz", "--draws=3", "--load-g=0", "--bias=2 kV"])
def test_options_of_another_format_are_refused(to, option, tmp_path):
    write_tree(whole(tree("voigt_kelvin_1")), tmp_path / "posterior.nc")
    arguments = [
        "export",
        str(tmp_path / "posterior.nc"),
        "--to",
        to,
        "-o",
        str(tmp_path / "x"),
        option,
    ]
    result = CliRunner().invoke(cli, arguments)
    assert isinstance(result.exception, UserError)
    takers = "state-space or abaqus or ansys" if "draws" in option else "state-space"
    assert f"{option.split('=')[0]} belongs to --to {takers}; --to {to} takes" in str(
        result.exception
    )
    assert not (tmp_path / "x").exists()


def test_the_command_hands_its_options_on(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia_circuit")
    write_tree(whole(posterior), tmp_path / "posterior.nc")
    arguments = (
        f"export {tmp_path}/posterior.nc --to state-space -o {tmp_path}/command.json".split()
    )
    arguments += ["--rate", "10 kHz", "--draws", "4", "--load-g", "300", "--bias", "2 kV"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    options = {"rate": "10 kHz", "draws": 4, "load_g": 300.0, "bias": "2 kV"}
    written = json.loads((tmp_path / "command.json").read_text())
    assert written == exported(posterior, tmp_path, **options)


def test_a_rate_that_misses_the_resonance_is_told(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia")
    said, model = {}, exported(posterior, tmp_path, draws=5)
    poles = np.linalg.eigvals(np.array(model["continuous"]["A"]))
    rings = np.abs(poles.imag).max(axis=1) / (2 * np.pi)
    resonance = float(np.median(rings))
    for times in (1.9, 2.1):
        options = {"rate": times * resonance, "draws": 5}
        said[times] = export(posterior, "state-space", tmp_path / "model.json", **options)
    assert said[2.1] == []
    assert f"rings at {resonance:.3g} Hz" in said[1.9][0]
    without_mass = tree("voigt_kelvin_2")
    assert export(without_mass, "state-space", tmp_path / "m.json", rate="1 mHz") == []


def test_the_command_says_what_is_to_be_heeded(tmp_path):
    write_tree(whole(tree("voigt_kelvin_2_inertia")), tmp_path / "posterior.nc")
    arguments = f"export {tmp_path}/posterior.nc --to state-space -o {tmp_path}/model.json".split()
    result = CliRunner().invoke(cli, [*arguments, "--rate", "2 Hz"])
    assert result.exit_code == 0
    assert "model.json: --rate 2 Hz: the model rings at" in result.stderr
