"""Populations of simulated specimens: do the intervals of mean and spread hold the truth?

Mean and spread are drawn from their priors, five specimens from them, and of each a short
relaxation mu exp(-t / tau) with white noise of known size is recorded. A specimen's own
posterior, skewed and correlated, is drawn from a dense grid; the population is then sampled as
in a study, with one ensemble. Truths drawn from the prior are in 90 % of 90 % intervals.

    python -m tests.validation.population --replicates 100

Rows are appended as replicates finish, so a stopped run goes on where it was. With --noise
instead: log-likelihoods of the population from mixtures and from averages over draws, against
the exact ones.
"""

from __future__ import annotations

import argparse
import csv
import time as clock
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.population.coordinate import Coordinate
from deabayes.population.member import Member
from deabayes.population.model import PopulationModel, sample
from deabayes.population.specimens import new_specimens, shrink
from deabayes.prior.distributions import LogNormal
from deabayes.prior.joint import Prior
from deabayes.study import Sampling
from tests.shared.populations import parameter, world
from tests.validation import rows

OUTPUT = Path("docs/validation")
SEED = 20261122
SPECIMENS, DRAWS = 5, 4000
TIME = np.linspace(0.5, 20.0, 40)
NOISE = 1.5e3
PRIOR = Prior([parameter("mu", LogNormal(35e3, 0.4)), parameter("tau", LogNormal(20.0, 0.6), "s")])
SPREAD = {name: {"distribution": "halfnormal", "sd": 0.3} for name in PRIOR.names}
SAMPLING = Sampling(ensembles=1, walkers=32, particles=128, max_steps=4000)
INTERVAL = (0.05, 0.95)


def response(theta: FloatArray) -> FloatArray:
    """mu exp(-t / tau), (W, N)."""
    return np.asarray(theta[:, :1] * np.exp(-TIME / theta[:, 1:]))


def posterior(record: FloatArray, truth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws (K, 2) of a specimen's own posterior: a grid of log theta, jittered in its cells."""
    axes = [
        np.linspace(-half, half, 241) + np.log(t) for half, t in zip((0.5, 1.6), truth, strict=True)
    ]
    phi = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    theta = np.exp(phi)
    log_p = -0.5 * np.sum((record - response(theta)) ** 2, axis=1) / NOISE**2
    log_p += PRIOR.log_density(theta) + phi.sum(axis=1)
    p = np.exp(log_p - log_p.max())
    cell = np.array([axis[1] - axis[0] for axis in axes])
    picked = phi[rng.choice(len(phi), DRAWS, p=p / p.sum())]
    return np.exp(picked + cell * rng.uniform(-0.5, 0.5, picked.shape))


def replicate(task: rows.Task) -> rows.Row:
    """One population: which intervals hold the truth, and how much narrower the shrunken are."""
    started = clock.process_time()
    rng = np.random.default_rng([SEED, int(task["replicate"])])
    coordinate = Coordinate.of(PRIOR.parameters)
    mean = np.log(PRIOR.sample(rng, 1)[0])
    spread = np.abs(0.3 * rng.standard_normal(2))
    truths = np.exp(mean + spread * rng.standard_normal((SPECIMENS + 1, 2)))
    members = []
    for index, truth in enumerate(truths[:-1]):
        record = response(truth[None])[0] + NOISE * rng.standard_normal(TIME.size)
        draws = posterior(record, truth, rng)
        members.append(Member.of(f"strip_{index}", draws, PRIOR, coordinate, DRAWS))
    model = PopulationModel.of(coordinate, members, SPREAD)
    pooled = sample(model, SAMPLING, np.random.SeedSequence([SEED, int(task["replicate"]), 1]))
    z = pooled.chain.reshape(-1, model.dimension)
    z = z[np.linspace(0, len(z) - 1, 4000).astype(int)]
    centres, spreads = model.split(model.prior.to_parameters(z))
    new = np.log(new_specimens(model, centres, spreads, rng)[0])
    found = {
        "converged": bool(pooled.convergence.converged),
        "mean_inside": inside(centres, mean),
        "spread_inside": inside(spreads, spread),
        "new_inside": inside(new, np.log(truths[-1])),
    }
    return found | of_specimens(model, centres, spreads, np.log(truths[:-1]), rng) | {
        "mean_mu": mean[0], "mean_tau": mean[1], "spread_mu": spread[0], "spread_tau": spread[1],
        "misfit": max(member.likelihood.misfit for member in members),
        "seconds": round(clock.process_time() - started, 2),
    }  # fmt: skip


def inside(draws: FloatArray, truth: FloatArray) -> int:
    """How many of the two parameters' 90 % intervals hold the truth."""
    low, high = np.quantile(draws, INTERVAL, axis=0)
    return int(np.sum((low <= truth) & (truth <= high)))


def of_specimens(
    model: PopulationModel,
    centres: FloatArray,
    spreads: FloatArray,
    truths: FloatArray,
    rng: np.random.Generator,
) -> rows.Row:
    """Specimens' intervals that hold the truth, of both kinds, and the median ratio of widths."""
    own = shrunken = unreliable = 0
    ratios = []
    for index, (member, truth) in enumerate(zip(model.members, truths, strict=True)):
        draws = centres[::4], spreads[::4]
        found = shrink(model, index, *draws, draws)
        after = member.phi[rng.choice(len(member.phi), DRAWS, p=found.weights)]
        unreliable += not found.reliable
        own, shrunken = own + inside(member.phi, truth), shrunken + inside(after, truth)
        widths = [np.ptp(np.quantile(d, INTERVAL, axis=0), axis=0) for d in (after, member.phi)]
        ratios.append(widths[0] / widths[1])
    return {
        "own_inside": own,
        "shrunken_inside": shrunken,
        "unreliable": unreliable,
        "width_ratio_mu": float(np.median(ratios, axis=0)[0]),
        "width_ratio_tau": float(np.median(ratios, axis=0)[1]),
    }


def summary(path: Path) -> list[dict[str, object]]:
    """Shares of intervals that hold the truth, over all rows of a file."""
    done = list(rows.read(path))
    of = {"mean_inside": 2, "spread_inside": 2, "new_inside": 2,
          "own_inside": 2 * SPECIMENS, "shrunken_inside": 2 * SPECIMENS}  # fmt: skip
    return [
        {
            "quantity": name.removesuffix("_inside"),
            "intervals": each * len(done),
            "coverage": f"{sum(int(row[name]) for row in done) / (each * len(done)):.3f}",
        }
        for name, each in of.items()
    ]


def noise(repeats: int = 20) -> list[dict[str, object]]:
    """Error of log p(y | m, s) of six normal specimens, sd 0.1 each, 8000 draws, against exact.

    At the true mean, relative to a spread of three sds, at which either is nearly exact.
    """
    ratios = (0.03, 0.1, 0.3, 1.0)
    errors: dict[str, list[FloatArray]] = {"mixture": [], "draws": []}
    for repeat in range(repeats):
        rng = np.random.default_rng([SEED, repeat, 2])
        mean = np.log([2e4, 3.0])
        known = world(mean, np.full(2, 0.01), np.full((6, 2), 0.1), rng)
        spreads = 0.1 * np.repeat([[*ratios, 3.0]], 2, axis=0).T
        centres = np.tile(mean, (len(spreads), 1))
        exact = known.log_likelihood(centres, spreads).sum(axis=1)
        by_mixture = known.model.log_likelihood(centres, spreads).sum(axis=1)
        by_draws = sum(averaged(m, centres, spreads) for m in known.model.members)
        for name, found in (("mixture", by_mixture), ("draws", by_draws)):
            error = found - exact
            errors[name].append(error[:-1] - error[-1])
    return [
        {
            "spread over sd": ratio,
            **{f"{n}, mean error": f"{np.mean(e, axis=0)[k]:.2f}" for n, e in errors.items()},
            **{f"{n}, sd of it": f"{np.std(e, axis=0)[k]:.2f}" for n, e in errors.items()},
        }
        for k, ratio in enumerate(ratios)
    ]


def averaged(member: Member, centres: FloatArray, spreads: FloatArray) -> FloatArray:
    """log mean_k N(phi_k; m, s^2) / pi(phi_k), (W,)."""
    scaled = (member.phi[None] - centres[:, None]) / spreads[:, None]
    log_terms = -0.5 * (scaled**2).sum(axis=2) - np.log(spreads).sum(axis=1)[:, None]
    return np.asarray(np.logaddexp.reduce(log_terms - member.log_prior, axis=1))


def write_table(path: Path, table: Sequence[dict[str, object]]) -> None:
    """Write a small table anew, and show it."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    print(path.read_text(encoding="utf-8"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicates", type=int, default=100)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--noise", action="store_true")
    arguments = parser.parse_args()
    if arguments.noise:
        write_table(OUTPUT / "population_noise.csv", noise())
        return
    path = OUTPUT / "population_rows.csv"
    tasks = [{"replicate": index} for index in range(arguments.replicates)]
    rows.append(path, tasks, replicate, SEED, arguments.processes)
    write_table(OUTPUT / "population.csv", summary(path))


if __name__ == "__main__":
    main()
