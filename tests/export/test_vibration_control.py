"""The how-to's controller, designed from an exported file of a made-up posterior."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import control
import numpy as np
import pytest
from click.testing import CliRunner
from tests.shared.tube_trees import CIRCUIT, specimen, tree

from deabayes.cli.main import cli
from deabayes.export import export
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.tubular.base import moving_mass
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import Harmonic
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

MASSES = ("total_mass", "active_mass", "sensor_mass")
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/how-to/vibration-control.md"


def script(name):
    """A script of docs/examples as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def example():
    return script("vibration_control")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("control") / "model.json"
    posterior = tree("voigt_kelvin_2_inertia_circuit", size=20, spread=0.05)
    export(posterior, "state-space", path, bias="2 kV", load_g=300.0)
    return path


@pytest.fixture(scope="module")
def design(example, file):
    """Plants, base transmissions, loops at unit gain, critical and largest gains."""
    plants, bases = zip(*example.systems(file), strict=True)
    loops = example.responses([plant * example.skyhook() for plant in plants])
    critical = np.array([control.stability_margins(p * example.skyhook())[0] for p in plants])
    return plants, bases, loops, critical, example.largest_gains(loops, critical)


def test_the_robust_gain_keeps_every_draw_within_its_margin(example, design):
    plants, _, loops, _, limits = design
    robust = limits.min()
    assert example.unstable(plants, robust) == 0.0
    assert example.peak_sensitivity(loops, robust).max() <= 2.0
    assert example.peak_sensitivity(loops, 1.01 * robust).max() > 2.0


def test_a_gain_tuned_on_the_median_fails_some_draws(example, design):
    """The median's own limit leaves half of the draws beyond it; a bold gain makes some swing."""
    plants, _, loops, critical, limits = design
    beyond = np.mean(example.peak_sensitivity(loops, np.median(limits)) > 2.0)
    assert 0.4 <= beyond <= 0.6
    assert 0.2 < example.unstable(plants, 0.98 * np.median(critical)) < 0.5


def test_the_critical_gain_is_where_poles_cross(example, design):
    plants, _, _, critical, _ = design
    for plant, gain in zip(plants, critical, strict=True):
        assert example.unstable([plant], 0.99 * gain) == 0.0
        assert example.unstable([plant], 1.01 * gain) == 1.0


@pytest.mark.parametrize("ending", ["json", "mat"])
def test_the_page_loads_both_files(ending, design, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    posterior = tree("voigt_kelvin_2_inertia_circuit", size=20, spread=0.05)
    export(posterior, "state-space", Path(f"model.{ending}"), bias="2 kV", load_g=300.0)
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    before, _, other = code.partition("  # or ")
    if ending == "mat":
        other, _, after = other.partition("\n")
        code = f"import scipy.io\n{before.rpartition('json.load(')[0]}{other}\n{after}"
    known = {}
    exec(compile(code, PAGE.name, "exec"), known)
    assert len(known["plants"]) == 40
    for plant, (acceleration, _) in zip(
        known["plants"], zip(*design[:2], strict=True), strict=True
    ):
        np.testing.assert_array_equal(plant.A, acceleration.A)
        assert plant.C.shape == (1, 5) and plant.B.shape == (5, 1)


@pytest.fixture(scope="module")
def exact(file):
    """The closed form of the actuator's response, with the draws of the file."""
    held = json.loads(file.read_text())["draws"]["parameters"]
    draws = {name: np.array(p["values"]) for name, p in held.items()}
    fixed = {n: np.full(40, q.value) for n, q in specimen().quantities.items()} | draws
    mass = moving_mass(*(fixed[n] for n in MASSES)) + 0.3
    inertia = mass * fixed["active_length"] / fixed["cross_section"]
    moving = MovingChain(Chain.from_draws(draws, 2), inertia)
    per_square = maxwell_pressure(1.0, fixed["thickness"], fixed["relative_permittivity"])
    return Harmonic(moving, Circuit(*(fixed[name] for name in CIRCUIT)), per_square, 2000.0)


def test_what_a_shaken_base_passes_on_to_the_mass(example, design, exact):
    """The chain's force over the mass's: 1 - M s^2 S/sigma = 1 / (1 + M s^2 D*)."""
    s = 2j * np.pi * example.FREQUENCY
    resisted = exact.chain.inertia[:, None] * s**2 * exact.chain.chain.complex_compliance(s)
    np.testing.assert_allclose(example.responses(design[1]), 1.0 / (1.0 + resisted), rtol=1e-6)


def test_the_loop_is_acceleration_integrated_and_delayed(example, design, exact):
    """The delay's approximant lies within 0.1 % up to 500 Hz."""
    kept = example.FREQUENCY < 500.0
    s = 2j * np.pi * example.FREQUENCY[kept]
    feedback = s / (s + example.HIGH_PASS) ** 2 * np.exp(-4e-4 * s)
    wanted = s**2 * exact.per_volt(example.FREQUENCY[kept]) * feedback
    np.testing.assert_allclose(design[2][:, kept], wanted, rtol=1e-3)


def test_the_reduction_is_that_of_every_draw(example, design):
    _, bases, loops, _, limits = design
    passive = np.abs(example.responses(bases))
    active = passive / np.abs(1.0 + limits.min() * loops)
    assert np.all(active.max(axis=1) < 1.5)
    assert np.all(20.0 * np.log10(passive.max(axis=1) / active.max(axis=1)) > 10.0)


def test_the_example_runs_and_draws_its_figure(example, file, tmp_path, capsys):
    example.main(str(file), str(tmp_path / "figure.png"))
    said = capsys.readouterr().out
    assert "40 draws" in said and "unstable in 0%" in said
    assert (tmp_path / "figure.png").stat().st_size > 1000


def test_the_simulated_study_of_the_how_to_is_sound(tmp_path, monkeypatch):
    script("vibration_study").main(tmp_path)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["check", "isolator"])
    assert result.exit_code == 0 and "0 faults" in result.output
    assert "tubular, simulated" in result.output
