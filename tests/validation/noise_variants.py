"""Which noise settings for vhb4910? Judged on its calibration records alone.

Each relaxation in turn is left out, the posterior annealed to the other four, and the record
predicted: a setting is good if the bands hold the left-out record as often as they say and
the CRPS is small. The held-out records of the study are not read.

    DEABAYES_DATA=... python -m tests.validation.noise_variants
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.guide import Guide
from deabayes.sampling.smc import anneal

from deabayes.experiment import FloatArray
from deabayes.pipeline.prepare import prepare_study
from deabayes.posterior import LogPosterior, Record, build
from deabayes.prediction.errors import crps
from deabayes.reading.specimen import read_specimen
from deabayes.studies import load_study
from deabayes.study import Sampling

OUTPUT = Path("docs/validation/noise_variants.csv")
CANDIDATES = ("kv_gm_3", "ogden_1_units_3")
SAMPLING = Sampling(ensembles=1, walkers=64, particles=512, max_steps=4000)
SIZE = {"distribution": "lognormal", "median": 0.05, "sigma": 0.02}
SHORT = {"distribution": "loguniform", "lower": 1, "upper": 5}
VARIANTS: Mapping[str, Mapping[str, object]] = {
    "in time, default priors": {"noise_coordinate": "record", "priors": {}},
    "along the grid, default priors": {"priors": {}},
    "along the grid, Matern-3/2": {"priors": {}, "noise": "matern32"},
    "along the grid, per record": {"priors": {}, "noise_groups": "experiment"},
    "along the grid, 1 to 5 points": {"priors": {"tau_ou": SHORT}},
    "along the grid, size 5 %": {"priors": {"sigma_ou": SIZE}},
    "along the grid, size 5 %, 1 to 5 points (shipped)": {},
}


def left_out(
    target: LogPosterior, z: FloatArray, record: Record, rng: np.random.Generator
) -> dict[str, float]:
    """Scores of one record predicted without it, from draws z of the full posterior."""
    name = record.experiment.name

    def removed(z: FloatArray) -> FloatArray:
        return -target.log_likelihood(target.prior.to_parameters(z), [name])

    result = anneal(z, target, removed, rng)
    draws = target.draws(target.prior.to_parameters(result.particles))
    mean = record.simulate(draws)
    noise_draws = target.noise_draws(draws, record.group)
    correlated, white = target.noise.sample(
        rng, record.noise_coordinate, record.weights, noise_draws
    )
    predicted = record.scale.with_residuals(mean, correlated + white)
    observed = record.experiment.response
    low, high = np.quantile(predicted, [0.05, 0.95], axis=0)
    spread = np.ptp(observed)
    misfit = np.median(mean, axis=0) - observed
    return {
        "joint log score": -result.log_evidence,
        "90 % band covers": float(np.mean((low <= observed) & (observed <= high))),
        "e_rms [%]": 100 * float(np.sqrt(np.mean(misfit**2)) / spread),
        "CRPS [% of range]": 100 * float(np.mean(crps(observed, predicted)) / spread),
    }


def row(target: LogPosterior, variant: str, candidate: str) -> dict[str, object]:
    """Mean scores of one setting over the left-out relaxations."""
    ensemble = run_ensemble(
        target.log_likelihood_of_normal,
        target.dimension,
        SAMPLING,
        np.random.SeedSequence(5),
        guide=Guide.of(target),
    )
    rng = np.random.default_rng(1)
    flat = ensemble.chain.reshape(-1, target.dimension)
    z = flat[rng.choice(len(flat), 1000)]
    scores = [left_out(target, z, record, rng) for record in target.records]
    means = {name: float(np.mean([s[name] for s in scores])) for name in scores[0]}
    means["joint log score"] *= len(scores)
    rounded = {name: f"{value:.4g}" for name, value in means.items()}
    long_enough = "yes" if ensemble.enough else "NO"
    return {
        "candidate": candidate,
        "noise": variant,
        "long enough": long_enough,
        **rounded,
        "deabayes": version("deabayes"),
    }


def main() -> None:
    study = load_study(Path("config.yaml"), "vhb4910")
    specimen = read_specimen(study.specimen)
    with tempfile.TemporaryDirectory() as folder:
        experiments = prepare_study(study, Path(folder))
    rows = []
    for candidate in CANDIDATES:
        for name, changes in VARIANTS.items():
            target = build(replace(study, **changes), candidate, specimen, experiments)  # type: ignore[arg-type]
            rows.append(row(target, name, candidate))
            print(rows[-1], flush=True)
    with OUTPUT.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
