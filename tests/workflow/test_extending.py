"""A made-up noise model and a made-up spring: one file and one registry line each."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LAPLACE = '''
"""Independent Laplace noise."""

import numpy as np

from deabayes.noise.base import NoiseModel
from deabayes.noise.base import white_amplitude


class Laplace(NoiseModel):
    """p(r) = exp(-|r|/b)/(2 b) with b = sigma_white sqrt(w_k)."""

    name = "laplace"
    diagnostic_only = True

    def parameters(self, unit, scale, span, coordinate_unit="s"):
        return (white_amplitude(unit, scale),)

    def _scaled(self, residuals, weights, draws):
        sigma = np.asarray(draws["sigma_white"], dtype=float)[:, None]
        scale = np.where(sigma > 0.0, sigma, np.nan) * np.sqrt(weights)
        whole = np.all(np.isfinite(residuals), axis=1)[:, None]
        return np.where(whole, residuals, np.nan) / scale, scale

    def pointwise_log_prob(self, residuals, coordinate, weights, draws):
        scaled, scale = self._scaled(residuals, weights, draws)
        return -np.abs(scaled) - np.log(2.0 * scale)

    def innovations(self, residuals, coordinate, weights, draws):
        from scipy.special import ndtri_exp

        scaled, _ = self._scaled(residuals, weights, draws)
        return -np.sign(scaled) * ndtri_exp(-np.abs(scaled) - np.log(2.0))

    def sample(self, rng, coordinate, weights, draws):
        scale = np.asarray(draws["sigma_white"])[:, None] * np.sqrt(weights)
        white = rng.laplace(0.0, scale)
        return np.zeros_like(white), white

    def variances(self, draws, weights):
        white = 2.0 * np.asarray(draws["sigma_white"], dtype=float) ** 2 * np.mean(weights)
        return np.zeros_like(white), white

    def spreads(self, draws, weights):
        sigma = np.asarray(draws["sigma_white"], dtype=float)[:, None]
        return np.zeros_like(sigma), sigma * np.sqrt(weights)

    def cumulative(self, scores, draws):
        return 0.5 * (1.0 - np.sign(scores) * np.expm1(-np.abs(scores)))
'''
YEOH = '''
"""Yeoh spring: powers of the first invariant."""

from deabayes.prior.distributions import LogNormal
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs.base import MODULUS_MEDIAN, Spring, column


class Yeoh(Spring):
    """W = sum_i c_i (I1 - 3)^i, Yeoh, Rubber Chem. Technol. 63 (1990) 792."""

    name = "yeoh"
    counts_terms = True

    def parameters(self, terms=1, modulus_median=MODULUS_MEDIAN):
        return tuple(
            Parameter(f"c_{i}", f"c_{i}", "Pa", f"coefficient {i}",
                      LogNormal(0.5 * modulus_median * 30.0 ** (1 - i), 1.5), "wide")
            for i in range(1, terms + 1)
        )

    def cauchy_stress(self, stretches, draws):
        squares = [stretch**2 for stretch in stretches]
        invariant = sum(squares) - 3.0
        slope = sum(
            i * column(draws[f"c_{i}"]) * invariant ** (i - 1)
            for i in range(1, len(draws) + 1) if f"c_{i}" in draws
        )
        return 2.0 * slope * (squares[0] - squares[2])

    def shear_modulus(self, draws):
        return 2.0 * draws["c_1"]
'''
ADDED = {
    "noise/laplace.py": ("noise/__init__.py", LAPLACE, "Laplace", "        White,\n"),
    "systems/springs/yeoh.py": ("systems/springs/__init__.py", YEOH, "Yeoh", "        Ogden,\n"),
}
USED = """
import numpy as np
import deabayes
from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.inference.log_posterior import build
from deabayes.study import Study

assert deabayes.__file__.startswith({source!r}), deabayes.__file__
time = np.linspace(0.0, 10.0, 40)
drive = Excitation("stretch", "1", time, 1.0 + 0.1 * time)
record = Experiment(
    "pull", "load_unload", "calibrate", "time", "s", time, "nominal_stress", "Pa",
    1e4 * np.log1p(time), np.ones(40), drive,
)
study = Study("made_up", {source!r}, ("yeoh_2", "yeoh_3_units_1"), noise="laplace")
for candidate in study.candidates:
    target = build(study, candidate, Specimen("strip", "tensile_strip", {{}}, {{}}), [record])
    z = np.random.default_rng(1).standard_normal((5, target.dimension))
    assert np.all(np.isfinite(target(z))), candidate
    print(candidate, *target.names)
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scratch copy of src/ with the two added: a file, its import and a registry line."""
    copy = tmp_path_factory.mktemp("scratch") / "src"
    shutil.copytree(ROOT / "src", copy)
    for path, (registry, text, name, before) in ADDED.items():
        (copy / "deabayes" / path).write_text(text)
        registry_file = copy / "deabayes" / registry
        lines = registry_file.read_text()
        assert lines.count(before) == 1
        module = ".".join(("deabayes", *Path(path).with_suffix("").parts))
        lines = lines.replace("annotations\n", f"annotations\n\nfrom {module} import {name}\n", 1)
        registry_file.write_text(lines.replace(before, f"{before}        {name},\n"))
    return copy


def run(source: Path, *arguments: str) -> str:
    """What Python prints with the scratch copy in the place of the package."""
    finished = subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(source)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


def test_they_make_a_posterior(source: Path) -> None:
    said = run(source, "-c", USED.format(source=str(source)))
    assert said.splitlines() == [
        "yeoh_2 c_1 c_2 load_unload.sigma_white",
        "yeoh_3_units_1 c_1 c_2 c_3 mu_beta_1 tau_1 load_unload.sigma_white",
    ]


def test_the_tests_of_the_registries_test_them(source: Path) -> None:
    tests = ("systems/test_springs.py", "noise/test_noise_models.py",
             "systems/test_tensile_strip.py", "statistical/test_noise_sampling.py")  # fmt: skip
    said = run(
        source,
        *("-m", "pytest", "-p", "no:cacheprovider", "-k", "yeoh or laplace", "-vv"),
        *(f"tests/{name}" for name in tests),
    )
    for name in ("test_stress_comes_from_an_energy[yeoh]", "[yeoh_4_units_4]",
                 "test_a_draw_does_not_depend_on_its_neighbours[laplace]"):  # fmt: skip
        assert f"{name} PASSED" in said
