"""Does the joint fit of the whole tubular actuator recover the truth, and as often as it says?

Actuators with two Kelvin units, mass and circuit are drawn from the priors of
`tubular_worlds.tubular_full`, put through a creep step and shaken under 100 and 500 g, and fitted
jointly with the same model and the same priors. Stored as for the membrane
(`membrane_recovery`): ranks, coverage, bias and sd per parameter, how the sampling went, and
the share of the held-out records' points inside the predictive bands.

    python -m tests.validation.tubular_recovery --replicates 100

Rows are appended as replicates finish, so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tests.validation import rows
from tests.validation.membrane_recovery import OUTPUT, SEED, compared
from tests.validation.sampled import SETTINGS, sample
from tests.validation.tubular_worlds import tubular_full
from tests.validation.worlds import given, simulate

UNITS = 2


def path_of(output: Path = OUTPUT) -> Path:
    """Where the replicates are kept."""
    return output / "tubular_recovery_voigt_kelvin_2_inertia_circuit.csv"


def replicate(task: rows.Task) -> rows.Row:
    """Simulate an actuator, fit it, and compare."""
    stream = np.random.SeedSequence([SEED, 1000, int(task["replicate"])])
    data_stream, fit_stream, pick_stream = stream.spawn(3)
    world = tubular_full()
    target = world.target(UNITS)
    data = simulate(world, target, np.random.default_rng(data_stream))
    # Noise priors of the median specimen, as the truth's: else ranks need not be uniform.
    sampled = sample(given(target, data.records), fit_stream, SETTINGS)
    return compared(sampled, data, np.random.default_rng(pick_stream))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    todo: list[rows.Task] = [{"replicate": index} for index in range(options.replicates)]
    rows.append(path_of(options.output), todo, replicate, SEED, options.processes)


if __name__ == "__main__":
    main()
