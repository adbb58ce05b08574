"""Populations of simulated specimens: do the intervals of mean and spread hold the truth?

Mean and spread are drawn from their priors, and five specimens from mean and spread. Each specimen
has a short relaxation mu exp(-t / tau) with white noise of known size. A specimen's own posterior,
skewed and correlated, is drawn from a dense grid. The population is then sampled as in a study,
with one ensemble. Truths drawn from the prior are in 90 % of 90 % intervals.

    python -m tests.validation.population --replicates 100

With --noise, log-likelihoods of the population from mixtures and from averages over draws are
compared with the exact ones instead.
"""

from __future__ import annotations

import time as clock
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


def summary(path: Path) -> list[rows.Row]:
    """Shares of intervals that hold the truth, over all rows of a file."""
    done = list(rows.read(path))
    intervals = {"mean": 2, "spread": 2, "new": 2, "own": 2 * SPECIMENS, "shrunken": 2 * SPECIMENS}
    return [
        {
            "quantity": name,
            "intervals": count * len(done),
            "coverage": f"{np.mean([int(r[f'{name}_inside']) for r in done]) / count:.3f}",
        }
        for name, count in intervals.items()
    ]


def noise(repeats: int = 20) -> list[rows.Row]:
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


def main() -> None:
    parser = rows.parser(__doc__)
    parser.add_argument("--noise", action="store_true")
    options = parser.parse_args()
    if options.noise:
        rows.write_table(options.output / "population_noise.csv", noise())
        return
    path = options.output / "population_rows.csv"
    tasks: list[rows.Task] = [{"replicate": index} for index in range(options.replicates)]
    rows.append(path, tasks, replicate, SEED, options.processes)
    rows.write_table(options.output / "population.csv", summary(path))


if __name__ == "__main__":
    main()
