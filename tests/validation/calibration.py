"""Simulation-based calibration: are the posteriors right as often as they say?

Parameters are drawn from the prior, records are simulated and fitted, and the truth is ranked
among the posterior draws. If everything is right, the ranks are uniform (Talts et al. 2018). The
empirical distribution of the ranks is compared with its 95 % simultaneous band (Saeilynoja,
Buerkner & Vehtari 2022). The negative control is a sampler whose draws are too narrow by a known
factor. It must leave the band.

    python -m tests.validation.calibration voigt_kelvin_2 --replicates 200
"""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from tests.validation import rank_figure, rows
from tests.validation.ecdf import inside
from tests.validation.sampled import sample
from tests.validation.strip_worlds import strip
from tests.validation.structure_worlds import at_rest
from tests.validation.tubular_worlds import tubular
from tests.validation.worlds import World, given

RANKS = 99
NARROW = 0.7
SEED = 20261121


def creep() -> World:
    """A creep record of the tubular actuator, with default priors."""
    return replace(tubular(), priors=lambda units: {})


MODELS = {"voigt_kelvin_2": (creep, 2), "kv_gm_1": (strip, 1), "ogden_1": (at_rest, 1)}


def simulate(target: LogPosterior, rng: np.random.Generator) -> tuple[FloatArray, LogPosterior]:
    """Return the true z (d,), drawn from the prior, and the posterior given simulated records."""
    finite = False
    while not finite:
        z = rng.standard_normal((1, target.dimension))
        theta = target.prior.to_parameters(z)
        responses = target.responses(theta)
        finite = all(np.isfinite(response).all() for response in responses.values())
    records = []
    for record in target.records:
        noise = target.noise_draws(target.draws(theta), record)
        parts = target.noise.sample(rng, record.experiment.coordinate, record.weights, noise)
        response = record.scale.with_residuals(responses[record.experiment.name], sum(parts))
        records.append(replace(record.experiment, response=response[0]))
    return z[0], given(target, records)


def replicate(candidate: str, task: rows.Task) -> rows.Row:
    """Rank the truth among the draws of one simulated data set."""
    world, order = MODELS[candidate]
    target = world().target(order)
    key = zlib.crc32(candidate.encode())
    stream = np.random.SeedSequence([SEED, key, int(task["replicate"])])
    data_stream, fit_stream, pick_stream = stream.spawn(3)
    truth, conditioned = simulate(target, np.random.default_rng(data_stream))
    sampled = sample(conditioned, fit_stream)
    rng = np.random.default_rng(pick_stream)
    flat = sampled.result.chain.reshape(-1, target.dimension)
    picked = flat[rng.choice(len(flat), RANKS, replace=False)]
    narrow = flat.mean(0) + NARROW * (picked - flat.mean(0))
    low, high = np.quantile(flat, [0.05, 0.95], axis=0)
    row: rows.Row = {
        "steps": sampled.result.steps,
        "enough": int(sampled.result.convergence.converged),
    }
    for k, name in enumerate(target.names):
        row[name] = int(np.sum(picked[:, k] < truth[k]))
        row[f"narrow:{name}"] = int(np.sum(narrow[:, k] < truth[k]))
        row[f"covered:{name}"] = int(low[k] <= truth[k] <= high[k])
    return row


def write(folder: Path) -> list[str]:
    """Write calibration.csv and its figures; return the names of the missing files."""
    table: list[rows.Row] = []
    missing = []
    for candidate in sorted(MODELS):
        path = folder / f"calibration_{candidate}.csv"
        if not path.exists():
            missing.append(path.name)
            continue
        replicates = pd.read_csv(path).sort_values("replicate")
        names = [n.removeprefix("covered:") for n in replicates if n.startswith("covered:")]
        table += [_summary(candidate, name, replicates) for name in names]
        ranks = {
            name: {
                "posterior ranks": replicates[name].to_numpy(),
                f"control: draws narrowed to {NARROW}": replicates[f"narrow:{name}"].to_numpy(),
            }
            for name in names
        }
        title = f"{candidate}: {len(replicates)} simulated data sets"
        rank_figure.draw(title, ranks, RANKS + 1, path.with_suffix(".png"))
    if table:
        rows.write_table(folder / "calibration.csv", table)
    return missing


def _summary(candidate: str, name: str, replicates: pd.DataFrame) -> rows.Row:
    """Return whether a parameter's ranks are in the band, the control's, and the coverage."""
    control_inside = inside(replicates[f"narrow:{name}"], RANKS + 1)
    return {
        "model": candidate,
        "parameter": name,
        "replicates": len(replicates),
        "ranks in 95 % band": "yes" if inside(replicates[name], RANKS + 1) else "NO",
        "coverage of 90 % interval": round(float(replicates[f"covered:{name}"].mean()), 3),
        f"control, draws narrowed to {NARROW}": "inside (control failed)"
        if control_inside
        else "leaves the band",
        "seed": SEED,
        "deabayes": version("deabayes"),
    }


def main() -> None:
    parser = rows.parser(__doc__, replicates=200)
    parser.add_argument("candidate", choices=sorted(MODELS))
    options = parser.parse_args()
    path = options.output / f"calibration_{options.candidate}.csv"
    tasks: list[rows.Task] = [{"replicate": index} for index in range(options.replicates)]
    compute = partial(replicate, options.candidate)
    rows.append(path, tasks, compute, None, options.processes)


if __name__ == "__main__":
    main()
