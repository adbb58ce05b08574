"""Do two seeds give the same posterior? Goal 5 of the statistical design.

Specimens of the recovery checks are fitted twice from the prior, with independent random streams.
The means and the ends of 90 % intervals of all parameters are compared, in posterior standard
deviations of the logarithm (mean of the two runs).

    python -m tests.validation.two_seeds --replicates 3
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from tests.validation import membrane_worlds, rows, structure_worlds, tubular_worlds
from tests.validation.sampled import SETTINGS, Sampled, sample
from tests.validation.worlds import World, given, simulate

FILE = "two_seeds.csv"
SEED = 20261128
MODELS: Mapping[str, tuple[Callable[[], World], int]] = {
    "kv_gm_1, steps": (membrane_worlds.membrane, 1),
    "kv_gm_2, steps": (membrane_worlds.membrane, 2),
    "voigt_kelvin_2, creep": (tubular_worlds.tubular, 2),
    "ogden_1, forces": (structure_worlds.at_rest, 1),
    "ogden_1_units_1, sines": (structure_worlds.in_motion, 1),
}
NUMBERS = {name: number for number, name in enumerate(MODELS)}


def posterior(model: str, stream: np.random.SeedSequence) -> LogPosterior:
    """The posterior of a simulated specimen, given records drawn from its own priors."""
    build, order = MODELS[model]
    world = build()
    target = world.target(order)
    return given(target, simulate(world, target, np.random.default_rng(stream)).records)


def compare(task: rows.Task) -> rows.Row:
    """Fit one specimen twice."""
    model = str(task["model"])
    stream = np.random.SeedSequence([SEED, NUMBERS[model], int(task["specimen"])])
    data_stream, *fit_streams = stream.spawn(3)
    target = posterior(model, data_stream)
    first, second = (sample(target, stream, SETTINGS) for stream in fit_streams)
    return differences(first, second)


def differences(first: Sampled, second: Sampled) -> rows.Row:
    """The largest differences over the parameters, and whether both runs passed their gates."""
    logarithms = np.log(first.theta), np.log(second.theta)
    spread = np.mean([draws.std(axis=0) for draws in logarithms], axis=0)
    mean = np.abs(logarithms[0].mean(axis=0) - logarithms[1].mean(axis=0)) / spread
    ends = np.abs(_ends(logarithms[0]) - _ends(logarithms[1])).max(axis=0) / spread
    both = first.result.convergence.converged and second.result.convergence.converged
    return {
        "both_converged": int(both),
        "mean_difference_sd": f"{mean.max():.4f}",
        "of_mean": first.target.names[int(mean.argmax())],
        "end_difference_sd": f"{ends.max():.4f}",
        "of_end": first.target.names[int(ends.argmax())],
        "cpu_seconds": f"{first.cpu_seconds + second.cpu_seconds:.1f}",
    }


def _ends(draws: FloatArray) -> FloatArray:
    return np.asarray(np.quantile(draws, [0.05, 0.95], axis=0))


def main() -> None:
    options = rows.parser(__doc__, replicates=3).parse_args()
    todo: list[rows.Task] = [
        {"model": model, "specimen": index}
        for index in range(options.replicates)
        for model in MODELS
    ]
    rows.append(options.output / FILE, todo, compare, SEED, options.processes)


if __name__ == "__main__":
    main()
