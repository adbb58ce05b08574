"""Which noise settings for vhb4910? Judged on its calibration records alone.

Each relaxation in turn is left out, the posterior annealed to the other four, and the record
predicted: a setting is good if the bands hold the left-out record as often as they say and
the CRPS is small. The held-out records of the study are not read.

    DEABAYES_DATA=... python -m tests.validation.noise_variants
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from deabayes.comparison.left_out import ON_THE_WAY
from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior, Record, build
from deabayes.pipeline import prepare_study
from deabayes.posteriors.problem import problem_of
from deabayes.prediction.errors import crps
from deabayes.records.specimen import read_specimen
from deabayes.sampling.problem import Problem
from deabayes.sampling.tempering import temper
from deabayes.studies import load_study
from tests.validation import rows
from tests.validation.sampled import sample

CANDIDATES = ("kv_gm_3", "ogden_1_units_3")
DRAWS = 1000
SIZE = {"distribution": "lognormal", "median": 0.05, "sigma": 0.02}
SHORT = {"distribution": "loguniform", "lower": 1, "upper": 5}
DEFAULTS: Mapping[str, object] = {"noise_scale": "mixed", "priors": {}}
VARIANTS: Mapping[str, Mapping[str, object]] = {
    "defaults: correlated in time": {**DEFAULTS, "noise_coordinate": "record"},
    "defaults, along the grid": DEFAULTS,
    "defaults, along the grid, per record": {**DEFAULTS, "noise_groups": "experiment"},
    "along the grid, 1 to 5 points": {"priors": {"tau_ou": SHORT}},
    "along the grid, size 5 %": {"priors": {"sigma_ou": SIZE}},
    "along the grid, size 5 %, 1 to 5 points (shipped)": {},
}


def left_out(
    target: LogPosterior,
    problem: Problem,
    z: FloatArray,
    record: Record,
    seed: np.random.SeedSequence,
) -> dict[str, float]:
    """Scores of one record predicted without it, from draws z (S, d) of the full posterior."""
    name = record.experiment.name

    def removed(z: FloatArray) -> FloatArray:
        return -target.log_likelihood(target.prior.to_parameters(z), [name])

    of_moves, of_noise = seed.spawn(2)
    rng, pair = np.random.default_rng(of_noise), z.reshape(2, -1, target.dimension)
    result = temper(pair, target, removed, of_moves, ON_THE_WAY, problem.coordinates, problem.hops)
    particles = result.particles.reshape(z.shape)
    draws = target.draws(target.prior.to_parameters(particles))
    mean = record.simulate(draws)
    noise_draws = target.noise_draws(draws, record)
    correlated, white = target.noise.sample(
        rng, record.noise_coordinate, record.weights, noise_draws
    )
    predicted = record.scale.with_residuals(mean, correlated + white)
    observed = record.experiment.response
    low, high = np.quantile(predicted, [0.05, 0.95], axis=0)
    spread = np.ptp(observed)
    misfit = np.median(mean, axis=0) - observed
    return {
        "joint log score": -float(np.logaddexp.reduce(result.log_evidence) - np.log(2.0)),
        "90 % band covers": float(np.mean((low <= observed) & (observed <= high))),
        "e_rms [%]": 100 * float(np.sqrt(np.mean(misfit**2)) / spread),
        "CRPS [% of range]": 100 * float(np.mean(crps(observed, predicted)) / spread),
    }


def row(target: LogPosterior, variant: str, candidate: str) -> dict[str, object]:
    """Mean scores of one setting over the left-out relaxations."""
    sampled = sample(target, np.random.SeedSequence(5)).result
    rng, problem = np.random.default_rng(1), problem_of(target)
    flat = sampled.chain.reshape(-1, target.dimension)
    z = flat[rng.choice(len(flat), DRAWS)]
    seeds = np.random.SeedSequence(1).spawn(len(target.records))
    scores = [
        left_out(target, problem, z, record, seed)
        for record, seed in zip(target.records, seeds, strict=True)
    ]
    means = {name: float(np.mean([s[name] for s in scores])) for name in scores[0]}
    means["joint log score"] *= len(scores)
    return {
        "candidate": candidate,
        "noise": variant,
        "converged": "yes" if sampled.convergence.converged else "NO",
        **{name: f"{value:.4g}" for name, value in means.items()},
        "deabayes": version("deabayes"),
    }


def main() -> None:
    study = load_study(Path("config.yaml"), "vhb4910")
    specimen = read_specimen(study.specimen)
    with tempfile.TemporaryDirectory() as folder:
        experiments = prepare_study(study, Path(folder))
    table = []
    for candidate in CANDIDATES:
        for name, changes in VARIANTS.items():
            target = build(replace(study, **changes), candidate, specimen, experiments)  # type: ignore[arg-type]
            table.append(row(target, name, candidate))
            print(table[-1], flush=True)
    rows.write_table(rows.OUTPUT / "noise_variants.csv", table)


if __name__ == "__main__":
    main()
