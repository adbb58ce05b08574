"""All ensembles together: their gates, and sampling on with refitted proposals until they pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.checkpoint import Arrays, Store
from deabayes.sampling.cloud import LogDensity
from deabayes.sampling.diagnostics import Convergence, assess
from deabayes.sampling.ensemble import Ensemble, align
from deabayes.sampling.extension import extend, ready, side_by_side
from deabayes.sampling.guide import NO_GUIDE, Guide
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.refit import better_proposals, leave_out
from deabayes.sampling.run import MINIMUM_STEPS, Run, Target, stage_seed
from deabayes.study import Sampling

Quantities = Callable[[FloatArray], Mapping[str, FloatArray]]

EXTENDED = 0
"""Random streams: 0 before the first refit, then the refit's number."""
REFIT, INSPECTED = 0, 2
MOST_REFITS = 6
LEFT_AFTER_REFIT = 2.0
"""Times what it throws away, or what the usual run needs, that the budget must leave after it."""
GROWTH = 1.5
"""Of the runs' length in autocorrelation times since the last refit, before the next."""
DROPPED_AFTER_REFIT = 0.1


@dataclass(frozen=True)
class PooledResult:
    """All ensembles of one candidate, and the verdict on them."""

    ensembles: tuple[Ensemble, ...]
    convergence: Convergence

    @property
    def chain(self) -> FloatArray:
        """Draws in z, (E, S, W, d), every run thinned evenly to the shortest."""
        return align(self.ensembles)[0]

    def thinned(self, most: int) -> tuple[FloatArray, FloatArray]:
        """z (E, S, d) and log-posterior (E, S), at most `most` per ensemble.

        They are spread evenly over time and by chance over the walkers: at even distances, where
        steps are about as many as picks, they would be of a few walkers.
        """
        chain, log_posterior = align(self.ensembles)
        _, steps, walkers, _ = chain.shape
        picked = np.linspace(0, steps * walkers - 1, min(most, steps * walkers), dtype=np.intp)
        step = picked // walkers
        shifts = np.random.default_rng(0).integers(walkers, size=(steps,))
        walker = (picked + shifts[step]) % walkers
        return chain[:, step, walker], log_posterior[:, step, walker]


def pool(
    log_likelihood: LogDensity,
    ensembles: Sequence[Ensemble],
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: bool = False,
    quantities: Quantities | None = None,
    guide: Guide = NO_GUIDE,
    processes: int = 1,
) -> PooledResult:
    """Judge ensembles together; when a gate fails, refit the proposals and sample on.

    Where runs agree and are nearly long enough they first go on as they are, nothing thrown
    away (see `extend`). Else only what follows the last refit is kept. Goes on in rounds until
    every gate passes or each ensemble has used `settings.max_steps`; the verdict says which.
    Proposals are refitted again, a few times at most, while runs are far from long enough and
    the budget leaves much more than a refit throws away, and then only to longer runs than the
    last time or where a proposal leaves out what runs have found since; where none gets better
    by it, nothing is thrown away. Where one run is held up and the usual one is not, what is left
    of the budget need be enough for the usual one only.

    Parameters
    ----------
    quantities : z (N, d) -> name -> (N,): what the gates apply to, parameters and
        derived quantities; the coordinates of z when None.
    guide : as the ensembles were sampled with.
    processes : how many ensembles are sampled on side by side, where checkpoints are kept in a
        folder; the draws do not depend on it.
    """
    convergence = judge(ensembles, settings, quantities)
    if convergence.converged or all(each.steps >= settings.max_steps for each in ensembles):
        return PooledResult(tuple(ensembles), convergence)
    store, refits, renewed, earlier = Store(folder), 0, 0, list[Ensemble]()
    target = Target(log_likelihood, guide)
    judged = partial(judge, settings=settings, quantities=quantities)
    ways = store.sub("extended"), stage_seed(seed, EXTENDED), progress, processes
    current, convergence = extend(target, ensembles, convergence, judged, settings, *ways)
    total, most, runs, seen = 0, 0, list[Run](), 0.0
    while not convergence.converged:
        times = float(np.nansum(convergence.autocorrelation_times))
        refit_pays = renewed < MOST_REFITS and _affordable(total, most, convergence, settings)
        rng = np.random.default_rng(stage_seed(seed, INSPECTED, total))
        refit_pays = refit_pays and (times > GROWTH * seen or leave_out(current, rng))
        if not runs or (refit_pays and _hopeless(total, convergence, settings)):
            refits, seen = refits + 1, times
            inside, stream = store.sub(f"refit_{refits}"), stage_seed(seed, refits)
            proposals = _refit(inside, current, earlier, guide, stream)
            if not runs or _differ(proposals, current):
                earlier += current
                ensembles, total, renewed = current, 0, renewed + 1
                runs = ready(target, ensembles, proposals, settings, stream, inside)
        most = max(settings.max_steps - each.steps for each in ensembles)
        if total >= most:
            break
        total = min(_next_total(total, renewed, convergence, settings), most)
        current = _continue_all(runs, ensembles, total, settings, progress, processes)
        convergence = judge(current, settings, quantities)
    return PooledResult(current, convergence)


def judge(
    ensembles: Sequence[Ensemble], settings: Sampling, quantities: Quantities | None = None
) -> Convergence:
    """Apply the gates to ensembles together (see `diagnostics.assess`)."""
    draws, log_posterior = align(ensembles)
    named = (quantities or _coordinates)(draws.reshape(-1, draws.shape[3]))
    dropped = [each.burn_in / (each.steps - each.burn_in) for each in ensembles]
    return assess(
        {name: np.asarray(values).reshape(draws.shape[:3]) for name, values in named.items()},
        settings,
        dropped=np.asarray(dropped),
        log_posterior=log_posterior,
        draws=draws,
    )


def _coordinates(z: FloatArray) -> dict[str, FloatArray]:
    return {f"z_{index + 1}": column for index, column in enumerate(z.T)}


def _differ(proposals: Sequence[Proposal], ensembles: Sequence[Ensemble]) -> bool:
    pairs = zip(proposals, ensembles, strict=True)
    return any(proposal is not ensemble.proposal for proposal, ensemble in pairs)


def _refit(
    store: Store,
    ensembles: Sequence[Ensemble],
    earlier: Sequence[Ensemble],
    guide: Guide,
    seed: np.random.SeedSequence,
) -> list[Proposal]:
    """The proposals of all ensembles refitted, or their own where those are better."""

    def compute() -> Arrays:
        rng = np.random.default_rng(stage_seed(seed, REFIT))
        found = better_proposals(ensembles, rng, guide.coordinates, earlier)
        own = [each.proposal for each in ensembles]
        new = [here is not before for here, before in zip(found, own, strict=True)]
        fitted = next((each for each, is_new in zip(found, new, strict=True) if is_new), own[0])
        return {"refitted": np.asarray(new), **fitted.arrays()}

    arrays = store.once("refitted", compute)
    fitted = Proposal.from_arrays(arrays, guide.coordinates)
    pairs = zip(ensembles, arrays["refitted"], strict=True)
    return [fitted if is_new else each.proposal for each, is_new in pairs]


def _continue_all(
    runs: Sequence[Run],
    ensembles: Sequence[Ensemble],
    total: int,
    settings: Sampling,
    progress: bool,
    processes: int,
) -> tuple[Ensemble, ...]:
    """Every ensemble sampled on to a total of steps; what is on disk already is not done again."""
    tasks = [
        partial(_continue, run, before, total, settings, progress)
        for run, before in zip(runs, ensembles, strict=True)
    ]
    return side_by_side(runs, tasks, processes)


def _continue(
    run: Run, first: Ensemble, total: int, settings: Sampling, progress: bool
) -> Ensemble:
    limit = min(total, settings.max_steps - first.steps)
    if limit < run.thin:
        return first
    run.advance(limit, may_stop=False, progress=progress)
    return run.ensemble(
        dropped=DROPPED_AFTER_REFIT,
        replaced_walkers=first.replaced_walkers,
        evaluations=np.asarray([first.evaluations, first.failures]),
        steps_before=first.steps,
        refitted=first.refitted or run.proposal is not first.proposal,
        limit=limit,
    )


def _wanted(total: int, times: float, settings: Sampling) -> float:
    """Steps since the refit that would be long enough where so many are `times` of them."""
    return 1.1 * total * settings.autocorrelation_times / max(times, 1e-3)


def _affordable(total: int, most: int, convergence: Convergence, settings: Sampling) -> bool:
    """Whether the budget leaves enough after a refit: for the usual run, as a walker caught where
    no proposal goes is one run's alone, and proposals refitted to what that run found go there.
    """
    usual = _wanted(total, float(np.median(convergence.autocorrelation_times)), settings)
    return most - total > LEFT_AFTER_REFIT * min(total, usual)


def _hopeless(total: int, convergence: Convergence, settings: Sampling) -> bool:
    return _longest(total, convergence, settings) > 3 * total


def _longest(total: int, convergence: Convergence, settings: Sampling) -> float:
    return _wanted(total, float(np.min(convergence.autocorrelation_times)), settings)


def _next_total(total: int, renewed: int, convergence: Convergence, settings: Sampling) -> int:
    """Steps since the last of so many refits to reach in the next round."""
    if total == 0:
        return MINIMUM_STEPS * 2 ** (renewed - 1)
    return int(np.clip(_longest(total, convergence, settings), 1.3 * total, 2.5 * total))
