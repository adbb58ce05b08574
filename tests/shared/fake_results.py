"""Results files of a made-up study: curves with invented posteriors.

Nothing is fitted; the files have the layout that posterior_file.py, pipeline.py
and preparation/prepared.py write.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from tests.shared.fake_records import MODULI, RELAXATION_TIMES, Fake, curve, experiment_of
from tests.shared.fake_tables import Draws, attributes_of, comparison, errors, summary_of

from deabayes.experiment import Experiment, FloatArray
from deabayes.noise import REGISTRY as NOISE_MODELS
from deabayes.records.preparation.prepared import write_prepared

CHAINS, DRAWS, PRIOR_DRAWS = 4, 300, 400


def write_study(folder: Path, fake: Fake | None = None, seed: int = 1) -> Path:
    """Write `folder/{name}` and return it."""
    fake = fake or Fake()
    rng = np.random.default_rng(seed)
    study = Path(folder) / fake.name
    (study / "prepared").mkdir(parents=True, exist_ok=True)
    experiments = [experiment_of(fake, i, p, rng) for i, p in enumerate(fake.protocols)]
    for experiment in experiments:
        write_prepared(experiment, study / "prepared" / f"{experiment.name}.nc")
    (study / "study.yaml").write_text(f"{fake.name}: {{noise: {fake.noise}}}\n")
    for units in fake.candidates:
        _write_candidate(study / f"kv_gm_{units}", fake, units, experiments, rng)
    comparison(fake).to_csv(study / "comparison.csv", index=False)
    return study


class _MadeUp(NamedTuple):
    """A parameter about `at`: sd of its logarithm in the posterior, and in the prior."""

    name: str
    symbol: str
    unit: str
    kind: str
    at: float
    sd: float
    width: float

    @property
    def attributes(self) -> dict[str, str]:
        prior = f"log-normal, median {1.3 * self.at:.3g}, sigma {self.width:g}"
        return {
            "symbol": self.symbol,
            "unit": self.unit,
            "kind": self.kind,
            "description": f"made-up {self.name.replace('_', ' ')}",
            "prior": "" if self.kind == "derived" else prior,
        }


def _parameters(fake: Fake, units: int, groups: Sequence[str]) -> Iterator[_MadeUp]:
    yield _MadeUp("mu_alpha", r"\mu_\alpha", "Pa", "material", 35e3, 0.01, 0.5)
    yield _MadeUp("zeta_alpha", r"\zeta_\alpha", "Pa*s", "material", 1e5, 0.48, 0.5)
    for i, modulus, time in zip(range(1, units + 1), MODULI, RELAXATION_TIMES, strict=False):
        symbols = rf"\mu_{{\beta {i}}}", rf"\tau_{{\beta {i}}}"
        yield _MadeUp(f"mu_beta_{i}", symbols[0], "Pa", "material", modulus, 0.03, 0.8)
        yield _MadeUp(f"tau_beta_{i}", symbols[1], "s", "material", time, 0.05, 2.0)
    yield _MadeUp("thickness", "H", "m", "specimen", 1e-3, 0.019, 0.02)
    yield _MadeUp("mu_total", r"\mu_\mathrm{total}", "Pa", "derived", 60e3, 0.004, 0.6)
    for group in groups:
        unit, s = ("1", 1 / 4e6) if group in ("sine", "creep") else ("Pa", 1.0)
        correlated = fake.correlated_noise * s
        values = {"sigma_white": (150.0 * s, 0.05), "degrees_of_freedom": (5.0, 0.1)}
        for p in NOISE_MODELS[fake.noise]().parameters(unit, 1.0, 1.0):
            usual = (30.0, 0.3) if p.name.startswith("tau_") else (correlated, 0.2)
            at, sd = values.get(p.name, usual)
            yield _MadeUp(f"{group}.{p.name}", p.symbol, p.unit, "noise", at, sd, 1.0)


def _draws(
    fake: Fake, units: int, groups: Sequence[str], rng: np.random.Generator
) -> dict[str, tuple[FloatArray, FloatArray, Mapping[str, str]]]:
    """name -> posterior (CHAINS, DRAWS), prior (1, PRIOR_DRAWS), attributes."""
    out: dict[str, tuple[FloatArray, FloatArray, Mapping[str, str]]] = {}
    common = rng.standard_normal((CHAINS, DRAWS))
    for each in _parameters(fake, units, groups):
        z = 0.7 * common + 0.71 * rng.standard_normal((CHAINS, DRAWS))
        if not fake.converged and each.name == "mu_alpha":
            z = z + 3.0 * np.arange(CHAINS)[:, None]
        spread = 0.3 * each.width + each.width * rng.standard_normal((1, PRIOR_DRAWS))
        posterior = each.at * np.exp(each.sd * z)
        out[each.name] = posterior, each.at * np.exp(spread), each.attributes
    return out


def _write_candidate(
    folder: Path,
    fake: Fake,
    units: int,
    experiments: Sequence[Experiment],
    rng: np.random.Generator,
) -> None:
    (folder / "predictions").mkdir(parents=True, exist_ok=True)
    groups = sorted({e.protocol for e in experiments if e.role == "calibrate"})
    draws = _draws(fake, units, groups, rng)
    posterior = {n: (("chain", "draw"), p, a) for n, (p, _, a) in draws.items()}
    prior = {n: (("chain", "draw"), p, a) for n, (_, p, a) in draws.items()}
    summary = summary_of(draws, fake)
    summary.to_csv(folder / "summary.csv", index_label="parameter")
    predictive, rows = {}, []
    for experiment in experiments:
        curves = _model(draws, units, experiment, rng.integers(0, DRAWS, 60), "posterior")
        scale = 1 / 4e6 if experiment.response_unit == "1" else 1.0
        dataset = _prediction(fake, experiment, curves * scale, scale)
        dataset.to_netcdf(folder / "predictions" / f"{experiment.name}.nc", engine="h5netcdf")
        rows.append(errors(dataset, experiment, fake, rng))
        if experiment.role == "calibrate":
            dimension = f"{experiment.name}_coordinate"
            prior_curves = _model(draws, units, experiment, np.arange(40), "prior") * scale
            predictive[experiment.name] = (("chain", "draw", dimension), prior_curves[None])
    pd.DataFrame(rows).to_csv(folder / "errors.csv", index=False)
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(posterior),
            "prior": xr.Dataset(prior),
            "prior_predictive": xr.Dataset(predictive),
            "sample_stats": xr.Dataset({"lp": (("chain", "draw"), np.zeros((CHAINS, DRAWS)))}),
        }
    )
    tree.attrs.update(attributes_of(fake, units, experiments))
    tree.to_netcdf(folder / "posterior.nc", engine="h5netcdf")


def _model(
    draws: Draws,
    units: int,
    experiment: Experiment,
    picked: FloatArray,
    group: str,
) -> FloatArray:
    def values(name: str) -> FloatArray:
        return draws[name][0 if group == "posterior" else 1][0, picked]

    branch = np.stack([values(f"mu_beta_{i + 1}") for i in range(units)], axis=1)
    tau = np.stack([values(f"tau_beta_{i + 1}") for i in range(units)], axis=1)
    stretch = experiment.excitation.at(experiment.coordinate)
    stretch = stretch / (1e3 if experiment.excitation.name == "voltage" else 1.0)
    return curve(experiment.coordinate, stretch, values("mu_alpha"), branch, tau)


def _prediction(fake: Fake, experiment: Experiment, curves: FloatArray, scale: float) -> xr.Dataset:
    median, spread = np.median(curves, axis=0), np.std(curves, axis=0)
    extra = {
        "parameter": 0.0,
        "discrepancy": fake.correlated_noise,
        "predictive": fake.correlated_noise + 200,
    }
    bands = {}
    for name, sd in extra.items():
        width = np.hypot(spread, sd * scale)
        both = [[median - z * width, median + z * width] for z in (0.674, 1.645)]
        bands[name] = (("level", "bound", "coordinate"), np.array(both))
    excitation = experiment.excitation.at(experiment.coordinate)
    return xr.Dataset(
        {
            "observed": ("coordinate", experiment.response),
            "mean": ("coordinate", curves.mean(axis=0)),
            "median": ("coordinate", median),
            "pit": ("coordinate", _pit(experiment)),
            "excitation": (
                "coordinate",
                excitation,
                {"units": experiment.excitation.unit, "long_name": experiment.excitation.name},
            ),
            **bands,
        },
        coords={
            "coordinate": ("coordinate", experiment.coordinate, {"name": "time", "units": "s"}),
            "level": [0.5, 0.9],
            "bound": ["lower", "upper"],
        },
        attrs={
            "experiment": experiment.name,
            "role": experiment.role,
            "protocol": experiment.protocol,
            "response_name": experiment.response_name,
            "response_unit": experiment.response_unit,
            "provenance": fake.provenance,
            "converged": int(fake.converged),
            "noise_group": experiment.protocol,
            "failed_draws": 0,
            "step": 0.0 if experiment.protocol in ("relaxation", "creep") else np.nan,
            "extrapolation": fake.extrapolation if experiment.role == "validate" else "",
        },
    )


def _pit(experiment: Experiment) -> FloatArray:
    """Nearly uniform of what was fitted, too much in the middle of what was held out."""
    rng = np.random.default_rng(experiment.coordinate.size)
    drawn = rng.random((experiment.coordinate.size, 2))
    return drawn[:, 0] if experiment.role == "calibrate" else drawn.mean(axis=1)
