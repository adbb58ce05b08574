"""Are a membrane's true parameters recovered, and held-out records covered, as often as said?

Specimens are drawn from the priors of `membrane_worlds.membrane` with n = 1, 2, 3 units, put
through steps to 2, 3 and 4 kV, and fitted with the same n and the same priors. Stored per
parameter: the rank of the truth among the draws, whether the 50 and 90 % intervals hold it, the
bias in posterior standard deviations and the posterior's sd; per data set: how the sampling went;
per held-out record: the share of its points inside the predictive bands. Replicates that
did not converge are kept and marked.

Variants: `ou` is the check; `white` fits the same data as if noise were independent and must
fail it; `dense` samples five times faster, and `dense_white` fits that as if noise were
independent; `iid` and `iid_white` fit data whose noise is independent, with the default noise
model and with the right one.

    python -m tests.validation.membrane_recovery 3 --replicates 100
    python -m tests.validation.membrane_recovery 2 --variant white

Rows are appended as replicates finish, so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from deabayes.prediction.bands import sample_response
from deabayes.prediction.noise_origin import NoiseOrigin
from tests.validation import rows
from tests.validation.membrane_worlds import membrane
from tests.validation.sampled import Sampled, sample
from tests.validation.worlds import OU, Simulated, World, given, group_of, simulate

OUTPUT = Path("docs/validation")
SEED = 20261122
RANKS = 99
PREDICTIVE_DRAWS = 1000


class Variant(NamedTuple):
    """Noise of the data, noise of the fit, and how much denser than usual the records are."""

    data: str = OU
    fit: str = OU
    refined: int = 1


VARIANTS = {
    "ou": Variant(),
    "white": Variant(fit="white"),
    "dense": Variant(refined=5),
    "dense_white": Variant(fit="white", refined=5),
    "iid": Variant(data="white"),
    "iid_white": Variant(data="white", fit="white"),
}


def path_of(order: int, variant: str = "ou", output: Path = OUTPUT) -> Path:
    """Where the replicates of an order and a variant are kept."""
    return output / f"membrane_recovery_{variant}_kv_gm_{order}.csv"


def replicate(task: rows.Task) -> rows.Row:
    """Simulate a specimen, fit it, and compare."""
    order, variant = int(task["order"]), VARIANTS[str(task["variant"])]
    world = membrane(variant.refined)
    target = world.target(order, variant.data)
    data, fit_stream, pick_stream = specimen(world, target, order, int(task["replicate"]))
    # Noise priors of the median specimen, as the truth's: else ranks need not be uniform.
    fit = given(world.target(order, variant.fit), data.records)
    return compared(sample(fit, fit_stream), data, np.random.default_rng(pick_stream))


def specimen(
    world: World, target: LogPosterior, order: int, replicate: int
) -> tuple[Simulated, np.random.SeedSequence, np.random.SeedSequence]:
    """A replicate's specimen and records, and the random streams of its fit and of its ranks."""
    stream = np.random.SeedSequence([SEED, order, replicate])
    data_stream, fit_stream, pick_stream = stream.spawn(3)
    return simulate(world, target, np.random.default_rng(data_stream)), fit_stream, pick_stream


def compared(sampled: Sampled, data: Simulated, rng: np.random.Generator) -> rows.Row:
    """How the sampling went, and the posterior against the truth and the records held out."""
    return {
        **sampled.row(),
        **_held_out(sampled, data, rng),
        **_parameters(sampled, data, rng),
    }


def _parameters(sampled: Sampled, data: Simulated, rng: np.random.Generator) -> rows.Row:
    """Rank, coverage, bias and sd of every parameter that the truth has too."""
    theta = sampled.theta
    ranked = theta[rng.choice(len(theta), RANKS, replace=False)]
    row: rows.Row = {}
    for column, name in enumerate(sampled.target.names):
        if name in data.truth:
            row |= comparison(name, theta[:, column], ranked[:, column], float(data.truth[name][0]))
    return row


def comparison(name: str, draws: FloatArray, ranked: FloatArray, truth: float) -> rows.Row:
    """One parameter's draws against its true value.

    The bias and the sd are those of the logarithm: parameters are positive, and their
    posteriors nearer to normal there.
    """
    low, lower, upper, high = np.quantile(draws, [0.05, 0.25, 0.75, 0.95])
    logarithm = np.log(draws)
    spread = float(logarithm.std())
    return {
        f"rank:{name}": int(np.sum(ranked < truth)),
        f"in50:{name}": int(lower <= truth <= upper),
        f"in90:{name}": int(low <= truth <= high),
        f"bias:{name}": f"{(logarithm.mean() - np.log(truth)) / spread:.4f}",
        f"sd:{name}": f"{spread:.5g}",
    }


def _held_out(sampled: Sampled, data: Simulated, rng: np.random.Generator) -> rows.Row:
    """Share of the points of held-out records inside the predictive bands.

    The noise of a record held out is that of its protocol's, or of the first record.
    """
    target = sampled.target
    draws = target.draws(sampled.thinned(PREDICTIVE_DRAWS))
    row: rows.Row = {}
    for experiment in data.held_out:
        proportional = experiment.response_name in target.system.proportional
        origin = NoiseOrigin(group_of(target, experiment), proportional=proportional)
        noise = target.noise_draws(draws, origin.group)
        samples = sample_response(
            target.system,
            target.noise,
            draws,
            noise,
            experiment,
            origin,
            experiment.coordinate,
            rng,
        )
        for level, (low, high) in zip((50, 90), samples.bands["predictive"], strict=True):
            inside = (low <= experiment.response) & (experiment.response <= high)
            row[f"held{level}:{experiment.name}"] = f"{inside.mean():.4f}"
        row[f"lost:{experiment.name}"] = samples.failed
    return row


def tasks(order: int, variant: str, replicates: int) -> Iterator[rows.Task]:
    for index in range(replicates):
        yield {"variant": variant, "order": order, "replicate": index}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("order", type=int, choices=(1, 2, 3))
    parser.add_argument("--variant", choices=sorted(VARIANTS), default="ou")
    parser.add_argument("--replicates", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    todo = list(tasks(options.order, options.variant, options.replicates))
    path = path_of(options.order, options.variant, options.output)
    rows.append(path, todo, replicate, SEED, options.processes)


if __name__ == "__main__":
    main()
