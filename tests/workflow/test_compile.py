"""`deabayes compile` leaves nothing for later stages to compile."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from deabayes import pipeline
from deabayes.cli.fitting import compile_study
from deabayes.integrate import compiled
from deabayes.pipeline import prepare_study
from deabayes.studies import load_study, write_study

ROOT = Path(__file__).resolve().parents[2]
LATER = """
import sys
import numpy as np
from pathlib import Path
from deabayes.prediction import bands as prediction
from deabayes.pipeline import build_target, read_experiments
from dataclasses import replace
from deabayes.inference.default_priors import further_prior, wider_systems
from deabayes.studies import load_study
from deabayes.sampling.warp import fit_warp

samples = np.random.default_rng(2).standard_normal((500, 4))
fit_warp(samples).inverse(fit_warp(samples).forward(samples))
study, prepared = replace(load_study(Path(sys.argv[1])), prior_from=None), Path(sys.argv[2])
for candidate in study.candidates:
    target = build_target(study, candidate, prepared)
    theta = target.prior.sample(np.random.default_rng(1), 3)
    assert np.all(np.isfinite(target.log_likelihood(theta)))
    target.pointwise_log_likelihood(theta)
    target.system.derived(target.draws(theta))
    draws = target.noise_draws(target.draws(theta), target.records[0].group)
    for e in read_experiments(prepared):
        f = target.system.predict(e.excitation, e.coordinate, e.response_name, target.draws(theta))
        weights = 1.0 / e.samples_averaged
        r = e.response - f
        target.noise.innovations(r, e.coordinate, weights, draws)
        target.noise.sample(np.random.default_rng(1), e.coordinate, weights, draws)
    further = further_prior(study, target.system, target.names)
    wide = further.sample(np.random.default_rng(1), 3).T
    wide = {**target.draws(theta), **dict(zip(further.names, wide))}
    for protocol, system in wider_systems(study, target.system).items():
        for e in read_experiments(prepared):
            if e.protocol == protocol:
                system.predict(e.excitation, e.coordinate, e.response_name, wide)
"""


def test_later_stages_find_everything_compiled(tmp_path: Path) -> None:
    """Also where the posterior that is to be the prior is still to come."""
    study = load_study(ROOT / "config.yaml", "tubular")
    study = replace(study, candidates=("voigt_kelvin_1", "voigt_kelvin_2"))
    assert study.prior_from is not None and study.predict_with
    study = replace(study, prior_from=str(tmp_path / "still_to_come.nc"))
    settings = tmp_path / "study.yaml"
    write_study(study, settings)
    prepare_study(study, tmp_path / "prepared")
    cache = tmp_path / "cache"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}

    def run(*arguments: str) -> set[Path]:
        subprocess.run([sys.executable, *arguments], env=environment, cwd=ROOT, check=True)
        return set(cache.rglob("*.nbc"))

    compiled = run("-m", "deabayes.cli.main", "compile", str(settings))
    assert any("log_prob" in path.name for path in compiled)
    assert run("-c", LATER, str(settings), str(tmp_path / "prepared")) == compiled


def test_studies_of_one_system_are_compiled_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside: list[str] = []

    @contextmanager
    def lock(name: str) -> Iterator[None]:
        inside.append(name)
        yield
        inside.clear()

    def build_target(*_: object) -> None:
        assert inside == ["compile_tubular"]
        raise KeyboardInterrupt

    write_study(load_study(ROOT / "config.yaml", "tubular"), tmp_path / "study.yaml")
    monkeypatch.setattr(compiled, "one_at_a_time", lock)
    monkeypatch.setattr(pipeline, "build_target", build_target)
    monkeypatch.setattr(pipeline, "read_experiments", lambda _: [])
    with pytest.raises(KeyboardInterrupt):
        compile_study(str(tmp_path / "study.yaml"), tmp_path / "none.yaml")
