"""Are true parameters recovered, and held-out records covered, as often as the posterior says?

Specimens are drawn from the priors of a world, put through its records, and fitted with the same
model and priors. Worlds: `membrane` (orders 1 to 3), `tubular` (order 2, with mass and circuit),
the tensile `strip`, and the minimum-energy structure at `rest` and in `motion` (orders 1 and 2).
Stored for every parameter: the rank of the truth among the draws, whether the 50 and 90 %
intervals contain it, the bias in posterior standard deviations, and the posterior's sd. Stored for
every specimen: how the sampling went. Stored for every held-out record: the share of its points
inside the predictive bands. Specimens whose posterior did not converge are kept and marked.

Variants of the membrane: `ou` is the check. `white` fits the same data as if the noise were
independent, and must fail the check. `dense` has five times as many points, and `dense_white` is
fitted as if their noise were independent. `iid` and `iid_white` fit data with independent noise,
with the default noise model and with the right one.

    python -m tests.validation.recovery membrane 3 --replicates 100
    python -m tests.validation.recovery membrane 2 --variant white
    python -m tests.validation.recovery rest 2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
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
from tests.validation.strip_worlds import strip
from tests.validation.structure_worlds import at_rest, in_motion
from tests.validation.tubular_worlds import tubular_full
from tests.validation.worlds import OU, Simulated, World, given, record_of, simulate

SEED = 20261122
RANKS = 99
PREDICTIVE_DRAWS = 1000


class Kind(NamedTuple):
    """A kind of specimens: its world, first random stream, and the name of the file of rows."""

    world: Callable[..., World]
    stream: int
    file: str


KINDS = {
    "membrane": Kind(membrane, 0, "membrane_recovery_{variant}_kv_gm_{order}.csv"),
    "tubular": Kind(tubular_full, 998, "tubular_recovery_voigt_kelvin_{order}_inertia_circuit.csv"),
    "strip": Kind(strip, 1500, "strip_recovery_kv_gm_{order}.csv"),
    "rest": Kind(at_rest, 2000, "structure_recovery_ogden_{order}.csv"),
    "motion": Kind(in_motion, 3000, "structure_recovery_ogden_1_units_{order}.csv"),
}


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


class Model(NamedTuple):
    """A model whose recovery is checked."""

    kind: str
    order: int
    variant: str = "ou"

    @property
    def file(self) -> str:
        """Name of the file of rows."""
        return KINDS[self.kind].file.format(order=self.order, variant=self.variant)

    def tasks(self, replicates: int) -> list[rows.Task]:
        """Return tasks whose names are the first columns of the file of rows."""
        columns: dict[str, dict[str, str | int]] = {
            "membrane": {"variant": self.variant, "order": self.order},
            "tubular": {},
            "strip": {"order": self.order},
        }
        first = columns.get(self.kind, {"stage": self.kind, "order": self.order})
        return [{**first, "replicate": index} for index in range(replicates)]

    def world(self) -> World:
        refined = VARIANTS[self.variant].refined
        return KINDS[self.kind].world(*([refined] if self.kind == "membrane" else []))


def replicate(model: Model, task: rows.Task) -> rows.Row:
    """Simulate a specimen, fit it, and compare."""
    world, variant = model.world(), VARIANTS[model.variant]
    target = world.target(model.order, variant.data)
    data, fit_stream, pick_stream = specimen(model, world, target, int(task["replicate"]))
    # The noise priors are those of the median specimen: otherwise ranks need not be uniform.
    fit = in_own_ranges(given(world.target(model.order, variant.fit), data.records))
    return compared(sample(fit, fit_stream), data, np.random.default_rng(pick_stream))


def in_own_ranges(target: LogPosterior) -> LogPosterior:
    """The target whose correlated noise is a share of each record's own range, as in a study."""
    records = (
        r if r.correlated_scale == 1.0 else replace(r, correlated_scale=r.experiment.response_range)
        for r in target.records
    )
    return replace(target, records=tuple(records))


def specimen(
    model: Model, world: World, target: LogPosterior, replicate: int
) -> tuple[Simulated, np.random.SeedSequence, np.random.SeedSequence]:
    """Return a replicate's specimen and records, and the random streams of fit and ranks."""
    key = KINDS[model.kind].stream + model.order
    data_stream, *streams = np.random.SeedSequence([SEED, key, replicate]).spawn(3)
    return simulate(world, target, np.random.default_rng(data_stream)), *streams


def compared(sampled: Sampled, data: Simulated, rng: np.random.Generator) -> rows.Row:
    """Compare the posterior with the truth and the held-out records."""
    row = sampled.row() | _held_out(sampled, data, rng)
    theta = sampled.theta
    ranked = theta[rng.choice(len(theta), RANKS, replace=False)]
    for k, name in enumerate(sampled.target.names):
        if name in data.truth:
            row |= comparison(name, theta[:, k], ranked[:, k], float(data.truth[name][0]))
    return row


def comparison(name: str, draws: FloatArray, ranked: FloatArray, truth: float) -> rows.Row:
    """Compare one parameter's draws with its true value.

    The bias and the sd are those of the logarithm: parameters are positive, and the posteriors of
    their logarithms are nearer to normal.
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
    """Return the share of the points of held-out records inside the predictive bands.

    The noise of a held-out record is that of its protocol, or of the first record.
    """
    target, system = sampled.target, sampled.target.system
    draws = target.draws(sampled.thinned(PREDICTIVE_DRAWS))
    row: rows.Row = {}
    for record in data.held_out:
        proportional = record.response_name in system.proportional
        like = record_of(target, record)
        scale = None if like.correlated_scale != 1.0 else 1.0
        origin = NoiseOrigin(like.group, correlated_scale=scale, proportional=proportional)
        noise = target.noise_draws(draws, replace(like, correlated_scale=1.0))
        samples = sample_response(
            system, target.noise, draws, noise, record, origin, record.coordinate, rng
        )
        for level, (low, high) in zip((50, 90), samples.bands["predictive"], strict=True):
            inside = (low <= record.response) & (record.response <= high)
            row[f"held{level}:{record.name}"] = f"{inside.mean():.4f}"
        row[f"lost:{record.name}"] = samples.failed
    return row


def main() -> None:
    parser = rows.parser(__doc__)
    parser.add_argument("kind", choices=list(KINDS))
    parser.add_argument("order", type=int, help="number of units, or of Ogden terms at rest")
    parser.add_argument("--variant", choices=list(VARIANTS), default="ou", help="of the membrane")
    options = parser.parse_args()
    model = Model(options.kind, options.order, options.variant)
    path: Path = options.output / model.file
    compute = partial(replicate, model)
    rows.append(path, model.tasks(options.replicates), compute, SEED, options.processes)


if __name__ == "__main__":
    main()
