"""Runs that go on from where they are: ready to, side by side, and kept whole where they agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from deabayes.sampling.checkpoint import Store
from deabayes.sampling.diagnostics import LONG_ENOUGH, Convergence
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.forked import run_apart
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.run import Run, Target, stage_seed
from deabayes.study import Sampling

CONTINUED = 1
NEARLY = 0.5
"""Of the length asked for: with less, proposals are refitted first."""
MOST_EXTENSIONS = 3
GROWTH = 1.3, 2.5
"""Of the kept steps, in one extension."""


def ready(
    target: Target,
    ensembles: Sequence[Ensemble],
    proposals: Sequence[Proposal],
    settings: Sampling,
    seed: np.random.SeedSequence,
    store: Store,
) -> list[Run]:
    """Each ensemble, ready to go on from its last step with a proposal."""
    return [
        Run(
            replace(target),
            proposals[index],
            (ensemble.chain[-1], ensemble.log_posterior[-1]),
            stage_seed(seed, CONTINUED, index),
            store.sub(f"continued_{index}"),
            settings,
            label=f"sampling on, ensemble {index + 1} of {len(ensembles)}",
        )
        for index, ensemble in enumerate(ensembles)
    ]


def side_by_side(
    runs: Sequence[Run], tasks: Sequence[Callable[[], Ensemble]], processes: int
) -> tuple[Ensemble, ...]:
    """What every run's task returns; what is on disk already is not done again."""
    if processes > 1 and all(run.store.folder is not None for run in runs):
        run_apart(tasks, processes)
        for run in runs:
            run.store.read_again()
    return tuple(task() for task in tasks)


def extend(
    target: Target,
    ensembles: Sequence[Ensemble],
    convergence: Convergence,
    judged: Callable[[Sequence[Ensemble]], Convergence],
    settings: Sampling,
    store: Store,
    seed: np.random.SeedSequence,
    progress: bool,
    processes: int,
) -> tuple[tuple[Ensemble, ...], Convergence]:
    """Sample on with the runs' own proposals while they agree and are nearly long enough.

    Nothing is thrown away, and each grows in proportion to what is kept of it, so that every
    run covers as many more of its own autocorrelation times: to one and a half times the length
    asked for, where the last fifth of a run may change its autocorrelation time a little.
    """
    runs: list[Run] = []
    current, grown = tuple(ensembles), 1.0
    for _ in range(MOST_EXTENSIONS):
        share = float(np.min(convergence.autocorrelation_times)) / settings.autocorrelation_times
        if convergence.converged or not convergence.agree or not share >= NEARLY:
            break
        grown *= float(np.clip(1.1 * LONG_ENOUGH / share, *GROWTH))
        added = [_added(each, grown, settings) for each in ensembles]
        if any(steps < each.thin for steps, each in zip(added, ensembles, strict=True)):
            break
        own = [each.proposal for each in ensembles]
        runs = runs or ready(target, ensembles, own, settings, seed, store)
        if any(each.thin % run.thin for run, each in zip(runs, ensembles, strict=True)):
            break  # another budget than they were sampled with stores steps that are further apart
        tasks = [
            partial(_gone_on, *each, progress) for each in zip(runs, ensembles, added, strict=True)
        ]
        current = side_by_side(runs, tasks, processes)
        convergence = judged(current)
    return current, convergence


def _added(first: Ensemble, grown: float, settings: Sampling) -> int:
    """Steps by which the kept ones become `grown` times as many, whole spacings of them."""
    wanted = min((grown - 1.0) * (first.steps - first.burn_in), settings.max_steps - first.steps)
    return int(wanted // first.thin) * first.thin


def _gone_on(run: Run, first: Ensemble, added: int, progress: bool) -> Ensemble:
    run.advance(added, may_stop=False, progress=progress)
    later = run.ensemble(
        dropped=0.0,
        replaced_walkers=first.replaced_walkers,
        evaluations=np.asarray([first.evaluations, first.failures]),
        steps_before=first.steps,
        refitted=first.refitted,
        limit=added,
        thin=first.thin,
    )
    return first.followed_by(later)
