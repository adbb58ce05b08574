"""Results files of a made-up study: linear viscoelastic curves with invented posteriors.

Nothing is fitted; the files have the layout that posterior_file.py, pipeline.py
and preparation/prepared.py write.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.noise import REGISTRY as NOISE_MODELS
from deabayes.preparation.prepared import write_prepared

CHAINS, DRAWS, PRIOR_DRAWS = 4, 300, 400
RELAXATION_TIMES = (0.7, 9.0, 120.0, 900.0)


@dataclass(frozen=True)
class Fake:
    """What the made-up study is like."""

    name: str = "fake_strip"
    provenance: str = "measured"
    converged: bool = True
    candidates: tuple[int, ...] = (1, 2, 3)
    protocols: tuple[str, ...] = ("relaxation", "relaxation", "load_unload", "load_unload")
    verdict: str = "chosen: the smallest order the data cannot do without"
    warnings: tuple[str, ...] = ()
    extrapolation: str = ""
    correlated_noise: float = 0.4e3
    noise: str = "ornstein_uhlenbeck"
    sensitivities: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """To prior and likelihood, by quantity, in place of made-up ones."""


def write_study(folder: Path, fake: Fake | None = None, seed: int = 1) -> Path:
    """Write `folder/{name}` and return it."""
    fake = fake or Fake()
    rng = np.random.default_rng(seed)
    study = Path(folder) / fake.name
    (study / "prepared").mkdir(parents=True, exist_ok=True)
    experiments = [_experiment(fake, i, p, rng) for i, p in enumerate(fake.protocols)]
    for experiment in experiments:
        write_prepared(experiment, study / "prepared" / f"{experiment.name}.nc")
    (study / "study.yaml").write_text(f"{fake.name}: {{noise: {fake.noise}}}\n")
    for units in fake.candidates:
        _write_candidate(study / f"kv_gm_{units}", fake, units, experiments, rng)
    _comparison(fake).to_csv(study / "comparison.csv", index=False)
    return study


def _experiment(fake: Fake, index: int, protocol: str, rng: np.random.Generator) -> Experiment:
    time = {
        "relaxation": np.geomspace(0.1, 1800, 120),
        "creep": np.geomspace(1e-3, 0.5, 120),
        "sine": np.linspace(0, 200, 1500),
    }.get(protocol, np.linspace(0.1, 120, 160))
    amplitude = 1.5 + 0.5 * (index % 6)
    excitation = _drive(protocol, time, amplitude)
    tau, mu = np.array(RELAXATION_TIMES), np.array([26e3, 26e3, 11e3, 6e3])
    clean = _curve(time, excitation, 35e3, mu[None], tau[None])[0]
    if protocol == "load_unload":
        clean = clean + 3e3 * np.tanh(2 * np.gradient(excitation, time) * 1e2) * (excitation - 1)
    response = clean + _correlated(time, fake.correlated_noise, 30.0, rng)
    response += 150.0 * rng.standard_normal(time.size)
    sine = protocol in ("sine", "creep")
    return Experiment(
        name=f"{protocol}_stretch_{amplitude:g}".replace(".", "p") + f"_{index}",
        protocol=protocol,
        role="validate" if index % 3 == 2 else "calibrate",
        coordinate_name="time",
        coordinate_unit="s",
        coordinate=time,
        response_name="strain" if sine else "nominal_stress",
        response_unit="1" if sine else "Pa",
        response=response / (4e6 if sine else 1.0),
        samples_averaged=np.ones_like(time),
        excitation=Excitation(
            "voltage" if sine else "stretch",
            "V" if sine else "1",
            time,
            excitation * (1e3 if sine else 1.0),
        ),
        metadata={"stretch": amplitude, "operator": "AB"},
        provenance=fake.provenance,
        record_sha256="0" * 64,
        steps=({"step": "mask_before", "time": "0.1 s"},),
        warnings=fake.warnings if index == 0 else (),
    )


def _drive(protocol: str, time: FloatArray, amplitude: float) -> FloatArray:
    if protocol == "load_unload":
        return 1 + (amplitude - 1) * (1 - np.abs(2 * time / time[-1] - 1))
    if protocol == "sine":
        return 1 + (amplitude - 1) * (1 - np.cos(2 * np.pi * 0.05 * time)) / 2
    return np.full_like(time, amplitude)


def _curve(
    time: FloatArray,
    stretch: FloatArray,
    mu: float | FloatArray,
    branch: FloatArray,
    tau: FloatArray,
) -> FloatArray:
    """Made-up stress (W, N): elastic part plus relaxing branches."""
    elastic = np.atleast_1d(mu)[:, None] * (stretch - stretch**-2.0)[None]
    decay = np.exp(-time[None, None] / tau[:, :, None])
    return elastic + 0.6 * np.sum(branch[:, :, None] * decay, axis=1) * (stretch - 1)[None]


def _correlated(time: FloatArray, sd: float, length: float, rng: np.random.Generator) -> FloatArray:
    values = np.empty_like(time)
    values[0] = sd * rng.standard_normal()
    for k, step in enumerate(np.diff(time), start=1):
        kept = np.exp(-step / length)
        values[k] = kept * values[k - 1] + sd * np.sqrt(1 - kept**2) * rng.standard_normal()
    return values


def _draws(
    fake: Fake, units: int, groups: Sequence[str], rng: np.random.Generator
) -> dict[str, tuple[FloatArray, FloatArray, Mapping[str, str]]]:
    """name -> posterior (CHAINS, DRAWS), prior (1, PRIOR_DRAWS), attributes."""
    out: dict[str, tuple[FloatArray, FloatArray, Mapping[str, str]]] = {}
    common = rng.standard_normal((CHAINS, DRAWS))

    def add(
        name: str, symbol: str, unit: str, kind: str, at: float, sd: float, width: float
    ) -> None:
        z = 0.7 * common + 0.71 * rng.standard_normal((CHAINS, DRAWS))
        if not fake.converged and name == "mu_alpha":
            z = z + 3.0 * np.arange(CHAINS)[:, None]
        prior = at * np.exp(0.3 * width + width * rng.standard_normal((1, PRIOR_DRAWS)))
        attributes = {
            "symbol": symbol,
            "unit": unit,
            "kind": kind,
            "description": f"made-up {name.replace('_', ' ')}",
            "prior": ""
            if kind == "derived"
            else f"log-normal, median {1.3 * at:.3g}, sigma {width:g}",
        }
        out[name] = (at * np.exp(sd * z), prior, attributes)

    add("mu_alpha", r"\mu_\alpha", "Pa", "material", 35e3, 0.01, 0.5)
    add("zeta_alpha", r"\zeta_\alpha", "Pa*s", "material", 1e5, 0.48, 0.5)
    for i in range(units):
        add(
            f"mu_beta_{i + 1}",
            rf"\mu_{{\beta {i + 1}}}",
            "Pa",
            "material",
            [26e3, 26e3, 11e3, 6e3][i],
            0.03,
            0.8,
        )
        add(
            f"tau_beta_{i + 1}",
            rf"\tau_{{\beta {i + 1}}}",
            "s",
            "material",
            RELAXATION_TIMES[i],
            0.05,
            2.0,
        )
    add("thickness", "H", "m", "specimen", 1e-3, 0.019, 0.02)
    add("mu_total", r"\mu_\mathrm{total}", "Pa", "derived", 60e3, 0.004, 0.6)
    for group in groups:
        unit, s = ("1", 1 / 4e6) if group in ("sine", "creep") else ("Pa", 1.0)
        correlated = fake.correlated_noise * s
        values = {"sigma_white": (150.0 * s, 0.05), "degrees_of_freedom": (5.0, 0.1)}
        for p in NOISE_MODELS[fake.noise]().parameters(unit, 1.0, 1.0):
            usual = (30.0, 0.3) if p.name.startswith("tau_") else (correlated, 0.2)
            at, sd = values.get(p.name, usual)
            add(f"{group}.{p.name}", p.symbol, p.unit, "noise", at, sd, 1.0)
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
    summary = _summary(draws, fake)
    summary.to_csv(folder / "summary.csv", index_label="parameter")
    predictive, rows = {}, []
    for experiment in experiments:
        curves = _model(draws, units, experiment, rng.integers(0, DRAWS, 60), "posterior")
        scale = 1 / 4e6 if experiment.response_unit == "1" else 1.0
        dataset = _prediction(fake, experiment, curves * scale, scale)
        dataset.to_netcdf(folder / "predictions" / f"{experiment.name}.nc", engine="h5netcdf")
        rows.append(_errors(dataset, experiment, fake, rng))
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
    tree.attrs.update(_attributes(fake, units, experiments))
    tree.to_netcdf(folder / "posterior.nc", engine="h5netcdf")


def _model(
    draws: Mapping[str, tuple[FloatArray, FloatArray, Mapping[str, str]]],
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
    return _curve(experiment.coordinate, stretch, values("mu_alpha"), branch, tau)


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
            "extrapolation": fake.extrapolation if experiment.role == "validate" else "",
        },
    )


def _pit(experiment: Experiment) -> FloatArray:
    """Nearly uniform of what was fitted, too much in the middle of what was held out."""
    rng = np.random.default_rng(experiment.coordinate.size)
    drawn = rng.random((experiment.coordinate.size, 2))
    return drawn[:, 0] if experiment.role == "calibrate" else drawn.mean(axis=1)


def _errors(
    dataset: xr.Dataset, experiment: Experiment, fake: Fake, rng: np.random.Generator
) -> dict[str, object]:
    residual = experiment.response - dataset["median"].values
    e_rms = 100 * float(np.sqrt(np.mean(residual**2))) / experiment.response_range
    e_m = 100 * float(np.abs(residual).max()) / experiment.response_range
    return {
        "experiment": experiment.name,
        "role": experiment.role,
        "protocol": experiment.protocol,
        "e_rms_percent": e_rms,
        "e_rms_q05": 0.95 * e_rms,
        "e_rms_q95": 1.2 * e_rms,
        "e_m_percent": e_m,
        "e_m_q05": 0.9 * e_m,
        "e_m_q95": 1.3 * e_m,
        "coverage_50": 0.4 + 0.2 * rng.random(),
        "coverage_90": 0.8 + 0.2 * rng.random(),
        "crps": float(np.abs(residual).mean()),
        "pit_p": 0.5 if experiment.role == "calibrate" else 0.001,
        "extrapolation": dataset.attrs["extrapolation"],
    }


def _summary(
    draws: Mapping[str, tuple[FloatArray, FloatArray, Mapping[str, str]]], fake: Fake
) -> pd.DataFrame:
    rows = {}
    for name, (posterior, prior, attributes) in draws.items():
        bad = not fake.converged and name == "mu_alpha"
        contraction = 1 - np.log(posterior).var() / np.log(prior).var()
        moved = fake.sensitivities.get(name, (0.08 * (1 - contraction), 0.08 * contraction))
        rows[name] = {
            "symbol": attributes["symbol"],
            "unit": attributes["unit"],
            "mean": posterior.mean(),
            "sd": posterior.std(),
            "median": np.median(posterior),
            "q05": np.quantile(posterior, 0.05),
            "q95": np.quantile(posterior, 0.95),
            "mcse_mean": posterior.std() / 30,
            "ess_bulk": 90.0 if bad else 900.0,
            "ess_tail": 700.0,
            "r_hat": 1.31 if bad else 1.003,
            "contraction": contraction,
            "prior_sensitivity": moved[0],
            "likelihood_sensitivity": moved[1],
            "converged": not bad,
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def _comparison(fake: Fake) -> pd.DataFrame:
    best = fake.candidates[-1]
    rows = [
        {
            "candidate": f"kv_gm_{n}",
            "order": n,
            "n_parameters": 9 + 2 * n,
            "log_evidence": -2000.0 - 60.0 * (best - n),
            "log_evidence_mcse": 0.2,
            "bic": 4000.0 + 110.0 * (best - n),
            "elpd_block_loo": -1980.0 - 55.0 * (best - n),
            "elpd_block_loo_se": 20.0,
            "elpd_leave_one_experiment_out": -2100.0 - 40.0 * (best - n),
            "worst_k_hat": 0.4,
            "converged": fake.converged,
            "verdict": fake.verdict
            if n == best
            else f"not chosen: elpd {-55 * (best - n)} (SE 9.1)",
        }
        for n in fake.candidates
    ]
    table = pd.DataFrame(rows)
    if not fake.converged:
        table["elpd_block_loo"] = np.nan
        table["verdict"] = "not ranked: not converged"
    return table


def _attributes(fake: Fake, units: int, experiments: Sequence[Experiment]) -> dict[str, str]:
    reasons = [] if fake.converged else ["mu_alpha: R-hat 1.310 is not below 1.01: sample longer"]
    convergence = {
        "converged": fake.converged,
        "reasons": reasons,
        "r_hat_max": 1.003 if fake.converged else 1.31,
        "ess_bulk_min": 900.0,
        "ess_tail_min": 700.0,
        "tau_max": 39.0,
        "steps": 5000,
        "walkers": 128,
        "ensembles": CHAINS,
        "failures": {"evaluations": 100000, "failed": 20},
    }
    sampling = {"ensembles": 4, "walkers": 128, "ess": 400, "r_hat": 1.01}
    settings = {
        "name": fake.name,
        "noise": fake.noise,
        "noise_scale": "absolute",
        "noise_groups": "protocol",
        "sampling": sampling,
    }
    records = [
        {"name": e.name, "protocol": e.protocol, "group": e.protocol, "scale": 1.0}
        for e in experiments
        if e.role == "calibrate"
    ]
    specimen = {
        "name": fake.name,
        "system": "tensile_strip",
        "provenance": {"kind": fake.provenance, "source": "made up for a test", "licence": "none"},
        "quantities": {
            "cross_section": {"value": 1e-5, "unit": "m^2", "sd": None, "source": "made up"}
        },
        "instruments": {},
    }
    return {
        "study": json.dumps(settings),
        "study_name": fake.name,
        "candidate": f"kv_gm_{units}",
        "order": str(units),
        "system": "tensile_strip",
        "specimen": json.dumps(specimen),
        "provenance": fake.provenance,
        "noise": fake.noise,
        "experiments": json.dumps(records),
        "convergence": json.dumps(convergence),
        "warnings": json.dumps(list(fake.warnings)),
        "deabayes_version": "0.1.0",
    }
