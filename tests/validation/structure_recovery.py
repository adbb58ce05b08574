"""Are a minimum-energy structure's true parameters recovered, as often as the posterior says?

Structures are drawn from the priors of `structure_worlds`, put through the records of one
stage, and fitted with the same model and priors. Stored as for the membrane
(`membrane_recovery`): ranks, coverage, bias and sd per parameter, how the sampling went, and
the share of held-out points inside the predictive bands.

    python -m tests.validation.structure_recovery rest 2 --replicates 100
    python -m tests.validation.structure_recovery motion 1 --replicates 50

Rows are appended as replicates finish, so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tests.validation import rows
from tests.validation.membrane_recovery import OUTPUT, SEED, compared
from tests.validation.sampled import SETTINGS, sample
from tests.validation.structure_worlds import at_rest, in_motion
from tests.validation.worlds import given, simulate

WORLDS = {"rest": at_rest, "motion": in_motion}
CANDIDATES = {"rest": "ogden_{}", "motion": "ogden_1_units_{}"}
STREAMS = {"rest": 2000, "motion": 3000}


def path_of(stage: str, order: int, output: Path = OUTPUT) -> Path:
    """Where the replicates of a stage and an order are kept."""
    return output / f"structure_recovery_{CANDIDATES[stage].format(order)}.csv"


def replicate(task: rows.Task) -> rows.Row:
    """Simulate a structure, fit it, and compare."""
    stage, order = str(task["stage"]), int(task["order"])
    stream = np.random.SeedSequence([SEED, STREAMS[stage] + order, int(task["replicate"])])
    data_stream, fit_stream, pick_stream = stream.spawn(3)
    world = WORLDS[stage]()
    target = world.target(order)
    data = simulate(world, target, np.random.default_rng(data_stream))
    # Noise priors of the median specimen, as the truth's: else ranks need not be uniform.
    sampled = sample(given(target, data.records), fit_stream, SETTINGS)
    return compared(sampled, data, np.random.default_rng(pick_stream))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stage", choices=sorted(WORLDS))
    parser.add_argument("order", type=int)
    parser.add_argument("--replicates", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    todo: list[rows.Task] = [
        {"stage": options.stage, "order": options.order, "replicate": index}
        for index in range(options.replicates)
    ]
    path = path_of(options.stage, options.order, options.output)
    rows.append(path, todo, replicate, SEED, options.processes)


if __name__ == "__main__":
    main()
