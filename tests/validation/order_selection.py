"""Does the shipped rule choose the right model order, and does it say when it cannot?

Specimens are drawn from the priors of `membrane_worlds`, `tubular_worlds`, `structure_worlds`
(films at rest, by Ogden terms) and `strip_worlds` (Ogden terms too). Every order from 1 to 3 is
fitted and scored for the shipped rule (`comparison.decision`): bridge evidence, BIC, block-LOO.
Worlds:

- `closed`: the truth is one of the candidates.
- `shown`: the same, and drawn again until the records can show its last unit (`order_signal`).
- `discrepancy`: the records also have a smooth error of 1 % of their range that no candidate has,
  even in the logarithm of time, or along the stretch. The right choice is still the true order.
- `shown_discrepancy`: the same, and drawn again until the last unit shows beside the error.
- `one_more`: the truth has four units. The right choice is three, the best there is.

The units of the truth are drawn from the prior. A second or third unit may be too weak, or too
close to another one, to be seen in any data. `signal` is how much of the last unit the records can
show, in nats (`order_signal`). `smallest_ratio` is the smallest ratio of neighbouring times, and
`noise_share` is the noise over the range of the records.

    python -m tests.validation.order_selection voigt_kelvin closed 2 --replicates 100
    python -m tests.validation.order_selection kv_gm one_more 4

A row contains the scores that the rule needs, but no verdict: `tally` decides anew. A change of the
rule can therefore be tried on specimens that are already fitted.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

from deabayes.comparison.decision import Score
from deabayes.comparison.evidence import bridge_evidence, maximum_log_likelihood
from deabayes.comparison.ranking import Ranked, score_all
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.problem import split_log_likelihood
from tests.validation import rows
from tests.validation.membrane_worlds import membrane
from tests.validation.order_signal import SHOWN, signal
from tests.validation.sampled import Sampled, sample
from tests.validation.strip_worlds import rubber
from tests.validation.structure_worlds import at_rest
from tests.validation.tubular_worlds import tubular
from tests.validation.worlds import Simulated, World, simulate

SEED = 20261123
CANDIDATES = (1, 2, 3)
STORED_DRAWS = 2000
"""Per ensemble, about as many as a posterior file holds."""

FAMILIES: Mapping[str, Callable[[], World]] = {
    "kv_gm": membrane,
    "voigt_kelvin": tubular,
    "film": at_rest,
    "rubber": rubber,
}
WORLDS = ("closed", "shown", "discrepancy", "shown_discrepancy", "one_more")


def replicate(task: rows.Task) -> rows.Row:
    """Simulate a specimen, fit and score every candidate."""
    family, world_name, order = str(task["family"]), str(task["world"]), int(task["truth"])
    key = zlib.crc32(f"{family} {world_name}".encode())
    stream = np.random.SeedSequence([SEED, key, order, int(task["replicate"])])
    data_stream, *streams, blocks = stream.spawn(2 + len(CANDIDATES))
    world = FAMILIES[family]()
    truth = world.target(order)
    data, seen = _simulated(world, truth, world_name, np.random.default_rng(data_stream))
    fits = [
        fitted(world.conditioned(candidate, data.records), seed)
        for candidate, seed in zip(CANDIDATES, streams, strict=True)
    ]
    scores = score_all([ranked for ranked, _ in fits], blocks)
    return {
        "signal": f"{seen:.2f}",
        **_specimen(truth, data),
        "ends": _ends(scores),
        **{name: value for score in scores for name, value in _score(score).items()},
        **{name: value for ranked, _ in fits for name, value in _noise(ranked).items()},
        "cpu_seconds": f"{sum(s.cpu_seconds for _, s in fits):.1f}",
    }


def fitted(target: LogPosterior, seed: np.random.SeedSequence) -> tuple[Ranked, Sampled]:
    """A candidate with its draws and its scores, as the commands `fit` and `score` leave it."""
    fit_stream, evidence_stream = seed.spawn(2)
    sampled = sample(target, fit_stream)
    z = sampled.z
    z = z[:, np.linspace(0, z.shape[1] - 1, min(STORED_DRAWS, z.shape[1])).astype(int)]
    theta = target.prior.to_parameters(z.reshape(-1, z.shape[2])).reshape(z.shape)
    tree = xr.DataTree.from_dict(
        {"posterior": xr.Dataset(
            {name: (("chain", "draw"), theta[:, :, k]) for k, name in enumerate(target.names)}
        )}
    )  # fmt: skip
    converged = bool(sampled.result.convergence.converged)
    tree.attrs.update(
        candidate=target.system.candidate,
        order=target.system.order,
        convergence=json.dumps({"converged": converged}),
    )
    return Ranked(tree, target, _scores(sampled, evidence_stream)), sampled


def _scores(sampled: Sampled, seed: np.random.SeedSequence) -> dict[str, float]:
    """What `deabayes score` computes."""
    target, z = sampled.target, sampled.z
    z = z[:, np.linspace(0, z.shape[1] - 1, min(STORED_DRAWS, z.shape[1])).astype(int)]
    effective = float(sampled.result.convergence.table["ess_bulk"].min()) / len(z)
    evidence = bridge_evidence(target, z, effective, seed)
    flat = z.reshape(-1, z.shape[2])
    maximum = maximum_log_likelihood(lambda z: split_log_likelihood(target, z), flat)
    points = sum(record.experiment.coordinate.size for record in target.records)
    return {
        "log_evidence": evidence.log_evidence,
        "log_evidence_mcse": evidence.mcse,
        "bic": target.dimension * float(np.log(points)) - 2.0 * maximum,
    }


def _simulated(
    world: World, truth: LogPosterior, world_name: str, rng: np.random.Generator
) -> tuple[Simulated, float]:
    """A specimen of a world, and how much of its last unit its records can show."""
    order = truth.system.order
    fewer = min(order, max(CANDIDATES)) - 1
    with_error, shown = "discrepancy" in world_name, world_name.startswith("shown")
    while True:
        data = simulate(world, truth, rng, with_error)
        enough = SHOWN if shown else 0.0
        seen = signal(world, order, fewer, data.truth, with_error, enough)
        if seen >= enough:
            return data, seen


def _specimen(truth: LogPosterior, data: Simulated) -> rows.Row:
    """How close the specimen's times are, and how noisy its records."""
    times = [float(v[0]) for n, v in data.truth.items() if n.startswith("tau")]
    ratios = [later / earlier for earlier, later in pairwise(times)]
    noise = truth.noise_draws(data.truth, truth.records[0])
    extent = max(record.response_range for record in data.records)
    size = float(np.hypot(noise["sigma_ou"][0], noise["sigma_white"][0]))
    return {
        "smallest_ratio": f"{min(ratios):.3f}" if ratios else "",
        "noise_share": f"{size / extent:.5f}",
    }


def _ends(scores: Sequence[Score]) -> str:
    """Which blocks are the first or last of their records, the same for every candidate."""
    ends = next((score.loo.ends for score in scores if score.loo), ())
    return " ".join(str(int(end)) for end in ends)


def _score(score: Score) -> rows.Row:
    terms = score.loo.terms if score.loo else ()
    return {
        f"parameters:{score.order}": score.n_parameters,
        f"log_evidence:{score.order}": f"{score.log_evidence:.3f}",
        f"mcse:{score.order}": f"{score.log_evidence_mcse:.3f}",
        f"bic:{score.order}": f"{score.bic:.3f}",
        f"terms:{score.order}": " ".join(f"{term:.3f}" for term in terms),
        f"k_hat:{score.order}": f"{score.loo.k_hat.max():.2f}" if score.loo else "",
    }


def _noise(ranked: Ranked) -> rows.Row:
    """What a candidate takes for correlated and for white noise, over the records' range."""
    target, order = ranked.target, ranked.target.system.order
    noise = target.noise_draws(target.draws(ranked.theta(STORED_DRAWS)), target.records[0])
    extent = max(record.experiment.response_range for record in target.records)
    return {
        f"{word}:{order}": f"{np.median(noise[name]) / extent:.5f}"
        for word, name in (("correlated", "sigma_ou"), ("white", "sigma_white"))
    }


def main() -> None:
    parser = rows.parser(__doc__)
    parser.add_argument("family", choices=sorted(FAMILIES))
    parser.add_argument("world", choices=WORLDS)
    parser.add_argument("truth", type=int, help="units of the truth; 4 in the world one_more")
    options = parser.parse_args()
    extra = options.truth > max(CANDIDATES)
    if options.truth < 1 or extra != (options.world == "one_more"):
        parser.error("truth is 1 to 3, and 4 in the world one_more")
    todo = [
        {"family": options.family, "world": options.world, "truth": options.truth, "replicate": i}
        for i in range(options.replicates)
    ]
    path = options.output / f"order_selection_{options.family}.csv"
    rows.append(path, todo, replicate, SEED, options.processes)


if __name__ == "__main__":
    main()
