"""Studies of made-up records, checked and fitted as a user would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from deabayes.api import Posterior, open_posterior
from deabayes.checks.folder import check_folder
from deabayes.checks.study import check_study
from deabayes.experiment import FloatArray
from deabayes.pipeline import fit_candidate, prepare_study
from deabayes.studies import load_studies
from deabayes.study import Study

FAST = {"particles": 128}


@dataclass(frozen=True)
class Made:
    """A study's folder and what the software says and finds of it."""

    path: Path
    study: Study

    @property
    def faults(self) -> list[str]:
        found = list(check_folder(self.path / "specimen", as_study=False).faults)
        return found or check_study(self.study).faults

    @property
    def warnings(self) -> list[str]:
        return [
            *check_folder(self.path / "specimen", as_study=False).warnings,
            *check_study(self.study).warnings,
        ]

    def fitted(self, candidate: str) -> Posterior:
        prepared, output = self.path / "prepared", self.path / candidate / "posterior.nc"
        if not prepared.is_dir():
            prepare_study(self.study, prepared)
        output.parent.mkdir()
        summary = output.with_name("summary.csv")
        fit_candidate(self.study, candidate, prepared, output, summary, progress=False)
        return open_posterior(output)


def made(
    path: Path,
    system: str,
    quantities: Mapping[str, tuple[float, str]],
    rows: Sequence[Mapping[str, object]],
    records: Mapping[str, Mapping[str, FloatArray]],
    candidates: Sequence[str],
    **settings: object,
) -> Made:
    """A folder with records, `name -> column with its unit -> values`, and its study."""
    folder = path / "specimen"
    (folder / "records").mkdir(parents=True)
    specimen = {
        "name": "s",
        "system": system,
        "provenance": {"kind": "simulated", "source": "test"},
        "quantities": {
            name: {"value": value, "unit": unit, "source": "test"}
            for name, (value, unit) in quantities.items()
        },
    }
    (folder / "specimen.yaml").write_text(yaml.safe_dump(specimen))
    pd.DataFrame(rows).to_csv(folder / "experiments.csv", index=False)
    for name, columns in records.items():
        pd.DataFrame(columns).to_csv(folder / "records" / f"{name}.csv", index=False)
    config = {
        "studies": {"s": {"specimen": str(folder), "candidates": list(candidates), **settings}},
        "sampling": FAST,
    }
    (path / "config.yaml").write_text(yaml.safe_dump(config))
    (study,) = load_studies(path / "config.yaml")
    return Made(path, study)


def row(name: str, protocol: str, excitation: str, response: str, **more: object) -> dict:
    """One row of experiments.csv."""
    return {
        "name": name, "protocol": protocol, "record": f"records/{name}.csv", "role": "calibrate",
        "excitation": excitation, "response": response, **more,
    }  # fmt: skip


def check(posterior: Posterior, truth: Mapping[str, float], share: float = 0.05) -> None:
    """Medians within five standard deviations, which are a small share of them."""
    assert posterior.converged
    table = posterior.summary()
    for name, value in truth.items():
        mean, sd = table.loc[name, ["mean", "sd"]]
        assert abs(mean - value) < 5.0 * sd, (name, mean, sd, value)
        assert sd < share * value, (name, mean, sd)


def noisy(values: FloatArray, sd: float, seed: int = 1) -> FloatArray:
    return values + sd * np.random.default_rng(seed).standard_normal(values.shape)
