"""Samplers of a membrane's posterior: effective draws per CPU second, and R-hat over time.

    OMP_NUM_THREADS=1 python -m benchmarks.membrane_recipes            # case A, small
    OMP_NUM_THREADS=1 python -m benchmarks.membrane_recipes --full     # cases A, B, P, full size
    ... --full --walkers 48 --steps 8000                               # a seventh of that

Cases A, B and P of mixing.md (tests/validation/cases.py), three units, noise parameters per
record (20 parameters). Small: two ensembles of 64 walkers, 2000 steps; full: the four of 128
that a study runs, 20000 steps. All samplers start from the shipped warm-up's walkers, whose
CPU seconds are in a column of their own. `shipped` is the whole recipe with pooling and refits,
one row at its end, warm-up included; `without refit` its first pass gone on with; `DE mix` is
0.8 DE + 0.2 jumps, `stretch` emcee's default. The others have a row whenever their steps have
doubled. The first fifth of the steps is dropped. Rows are appended to
docs/validation/membrane_recipes.csv; what is there is not run again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import emcee
import numpy as np
from tests.validation import rows
from tests.validation.cases import case

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.sampling import chains
from deabayes.sampling.checkpoint import Arrays, Store
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.guide import Guide
from deabayes.sampling.moves import DifferentialEvolutionMove, initial_state, recipe
from deabayes.sampling.pooling import pool
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.run import DROPPED_SHARE
from deabayes.study import Sampling

OUTPUT = Path("docs/validation/membrane_recipes.csv")
SEED = 20261126
SMALL = Sampling(ensembles=2, walkers=64, particles=512, max_steps=2000)
FULL = Sampling()
FIRST_ROW = 250
MOST_STORED = 1000
"""Steps per ensemble that diagnostics are computed from."""


def de_mix(frozen: Proposal) -> list[tuple[Any, float]]:
    return [(DifferentialEvolutionMove(), 0.8), (DifferentialEvolutionMove(gamma0=1.0), 0.2)]


def stretch(frozen: Proposal) -> list[tuple[Any, float]]:
    return [(emcee.moves.StretchMove(), 1.0)]


MOVES: Mapping[str, Callable[[Proposal], list[tuple[Any, float]]]] = {
    "without refit": recipe,
    "DE mix": de_mix,
    "stretch": stretch,
}


def started(
    target: LogPosterior, settings: Sampling, seeds: Sequence[np.random.SeedSequence]
) -> tuple[list[Arrays], float]:
    """Walkers and proposals that the shipped warm-up leaves, and its CPU seconds."""
    starts = []
    began = time.process_time()
    brief = Sampling(
        settings.ensembles, settings.walkers, max_steps=1, particles=settings.particles
    )
    for seed in seeds:
        with TemporaryDirectory() as folder:
            likelihood = target.log_likelihood_of_normal
            guide = Guide.of(target)
            run_ensemble(likelihood, target.dimension, brief, seed, Path(folder), guide=guide)
            starts.append(Store(Path(folder)).once("start", dict))
    return starts, time.process_time() - began


def doubling(steps: int) -> Iterator[int]:
    """FIRST_ROW, twice as many, ... and `steps`."""
    total = FIRST_ROW
    while total < steps:
        yield total
        total *= 2
    yield steps


def shipped(
    target: LogPosterior, settings: Sampling, seeds: Sequence[np.random.SeedSequence]
) -> Iterator[rows.Row]:
    """One row: the whole recipe, to convergence or the end of its budget."""
    began = time.process_time()
    *streams, pooling = seeds
    likelihood, guide = target.log_likelihood_of_normal, Guide.of(target)
    ensembles = [
        run_ensemble(likelihood, target.dimension, settings, s, guide=guide) for s in streams
    ]
    pooled = pool(likelihood, ensembles, settings, pooling, guide=guide)
    spent = time.process_time() - began
    yield row(max(each.steps for each in pooled.ensembles), pooled.chain, spent) | {
        "converged": int(pooled.convergence.converged)
    }


def plain(
    name: str, target: LogPosterior, starts: Sequence[Arrays], steps: int
) -> Iterator[rows.Row]:
    """Rows of one set of moves as its steps double."""
    coordinates = Guide.of(target).coordinates
    proposals = [Proposal.from_arrays(start, coordinates) for start in starts]
    samplers = [
        emcee.EnsembleSampler(
            *start["walkers"].shape, target, moves=MOVES[name](proposal), vectorize=True
        )
        for start, proposal in zip(starts, proposals, strict=True)
    ]
    states = [
        initial_state(s["walkers"], target(s["walkers"]), np.random.SeedSequence([SEED, e]))
        for e, s in enumerate(starts)
    ]
    spent, done = 0.0, 0
    for total in doubling(steps):
        began = time.process_time()
        states = [
            sampler.run_mcmc(state, total - done, skip_initial_state_check=True)
            for sampler, state in zip(samplers, states, strict=True)
        ]
        spent, done = spent + time.process_time() - began, total
        kept = np.stack([s.get_chain(discard=int(DROPPED_SHARE * total)) for s in samplers])
        yield row(total, kept[:, chains.thin_evenly(kept.shape[1], MOST_STORED)], spent)


def row(steps: int, chain: FloatArray, spent: float) -> rows.Row:
    """Diagnostics of draws (E, S, W, d), the worst of all coordinates."""
    coordinates = [chain[..., k] for k in range(chain.shape[3])]
    bulk = min(chains.ess_bulk(each) for each in coordinates)
    return {
        "steps": steps,
        "cpu_seconds": f"{spent:.2f}",
        "r_hat": f"{max(chains.r_hat(each) for each in coordinates):.4f}",
        "ess_bulk": f"{bulk:.0f}",
        "ess_tail": f"{min(chains.ess_tail(each) for each in coordinates):.0f}",
        "ess_per_cpu_second": f"{bulk / spent:.1f}",
        "autocorrelation_times": f"{bulk / chain.shape[0] / chain.shape[2]:.1f}",
        "converged": "",
    }


def run(names: Sequence[str], recipes: Sequence[str], settings: Sampling, output: Path) -> None:
    """Append what is missing, print every row."""
    for name in names:
        target = case(name, "experiment")
        seed = np.random.SeedSequence([SEED, *name.encode()])
        size = f"{settings.ensembles} x {settings.walkers}"
        tasks: list[rows.Task] = [
            {"case": name, "recipe": r, "walkers": size, "budget": settings.max_steps}
            for r in recipes
        ]
        waiting = rows.missing(output, tasks)
        if not waiting:
            print(f"case {name}, {settings.max_steps} steps: already in {output}")
            continue
        seeds = seed.spawn(settings.ensembles + 1)
        only_shipped = all(task["recipe"] == "shipped" for task in waiting)
        starts, warm_up = ([], 0.0) if only_shipped else started(target, settings, seeds[:-1])
        for task in waiting:
            kind = str(task["recipe"])
            found = (
                shipped(target, settings, seeds)
                if kind == "shipped"
                else plain(kind, target, starts, settings.max_steps)
            )
            before = "" if kind == "shipped" else f"{warm_up:.2f}"
            # All rows of a recipe at once: one that was stopped is run again.
            for each in list(found):
                whole = {**task, "warm_up_seconds": before, **each, **rows.provenance(SEED)}
                rows.write(output, whole)
                print(", ".join(f"{k} {v}" for k, v in whole.items() if v != ""), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    everything = ["shipped", *MOVES]
    parser.add_argument("--full", action="store_true", help="cases A, B, P at full size")
    parser.add_argument("--walkers", type=int, help="per ensemble, instead of the size's own")
    parser.add_argument("--steps", type=int, help="the budget, instead of the size's own")
    parser.add_argument("--cases", nargs="+", choices=["A", "B", "P"])
    parser.add_argument("--recipes", nargs="+", choices=everything, default=everything)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    names = options.cases or (["A", "B", "P"] if options.full else ["A"])
    options.output.parent.mkdir(parents=True, exist_ok=True)
    size = FULL if options.full else SMALL
    settings = replace(
        size, walkers=options.walkers or size.walkers, max_steps=options.steps or size.max_steps
    )
    run(names, options.recipes, settings, options.output)


if __name__ == "__main__":
    main()
