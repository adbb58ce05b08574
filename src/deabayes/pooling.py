"""All ensembles together: their gates, and sampling on with refitted proposals until they pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deabayes.checkpoint import Arrays, Store
from deabayes.diagnostics import Convergence, assess
from deabayes.ensemble import Ensemble, align
from deabayes.experiment import FloatArray
from deabayes.mixture import Mixture, fit
from deabayes.run import MINIMUM_STEPS, Run, Target, stage_seed
from deabayes.smc import LogDensity
from deabayes.study import Sampling

Quantities = Callable[[FloatArray], Mapping[str, FloatArray]]

REFIT, CONTINUED = range(2)
REFITTED_COMPONENTS = 8
REFIT_SAMPLE = 12000
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

    @property
    def log_posterior(self) -> FloatArray:
        """(E, S, W), as `chain`."""
        return align(self.ensembles)[1]


def pool(
    log_likelihood: LogDensity,
    ensembles: Sequence[Ensemble],
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: bool = False,
    quantities: Quantities | None = None,
) -> PooledResult:
    """Judge ensembles together; when a gate fails, refit the proposals once and sample on.

    Goes on in rounds until every gate passes or each ensemble has used
    `settings.max_steps`; the verdict says which.

    Parameters
    ----------
    quantities : z (N, d) -> name -> (N,): what the gates apply to, parameters and
        derived quantities; the coordinates of z when None.
    """
    convergence = judge(ensembles, settings, quantities)
    if convergence.converged or all(each.steps >= settings.max_steps for each in ensembles):
        return PooledResult(tuple(ensembles), convergence)
    store = Store(folder)
    runs = [
        Run(
            Target(log_likelihood),
            _refit(store, ensembles, index, seed),
            (ensemble.chain[-1], ensemble.log_posterior[-1]),
            stage_seed(seed, CONTINUED, index),
            store.sub(f"continued_{index}"),
            settings,
            label=f"sampling on, ensemble {index + 1} of {len(ensembles)}",
        )
        for index, ensemble in enumerate(ensembles)
    ]
    total, most = 0, max(settings.max_steps - each.steps for each in ensembles)
    continued: Sequence[Ensemble] = ensembles
    while not convergence.converged and total < most:
        total = min(_next_total(total, convergence, settings), most)
        continued = [
            _continue(run, first, total, settings, progress)
            for run, first in zip(runs, ensembles, strict=True)
        ]
        convergence = judge(continued, settings, quantities)
    return PooledResult(tuple(continued), convergence)


def continue_ensemble(
    log_likelihood: LogDensity,
    ensemble: Ensemble,
    mixture: Mixture,
    steps: int,
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: bool = False,
) -> Ensemble:
    """Sample an ensemble on for `steps` with another frozen proposal; keep only what follows."""
    start = ensemble.chain[-1], ensemble.log_posterior[-1]
    run = Run(Target(log_likelihood), mixture, start, seed, Store(folder), settings)
    return _continue(run, ensemble, steps, settings, progress)


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


def _refit(
    store: Store, ensembles: Sequence[Ensemble], index: int, seed: np.random.SeedSequence
) -> Mixture:
    """Fit a proposal to the pooled second halves of the other ensembles."""

    def compute() -> Arrays:
        others = [each for other, each in enumerate(ensembles) if other != index] or ensembles
        draws = [each.chain[len(each.chain) // 2 :] for each in others]
        flat = np.concatenate([each.reshape(-1, each.shape[2]) for each in draws])
        rng = np.random.default_rng(stage_seed(seed, REFIT, index))
        chosen = rng.choice(len(flat), min(REFIT_SAMPLE, len(flat)), replace=False)
        return fit(flat[chosen], REFITTED_COMPONENTS, rng).arrays()

    return Mixture.from_arrays(store.once(f"refitted_{index}", compute))


def _continue(
    run: Run, first: Ensemble, total: int, settings: Sampling, progress: bool
) -> Ensemble:
    limit = min(total, settings.max_steps - first.steps)
    if limit < run.thin:
        return first
    run.advance(limit, stop_when_enough=False, progress=progress)
    return run.ensemble(
        dropped=DROPPED_AFTER_REFIT,
        replaced_walkers=first.replaced_walkers,
        evaluations=np.asarray([first.evaluations, first.failures]),
        steps_before=first.steps,
        refitted=True,
    )


def _next_total(total: int, convergence: Convergence, settings: Sampling) -> int:
    """Steps after the refit to reach in the next round, from how many are still wanted."""
    if total == 0:
        return MINIMUM_STEPS
    shortest = max(float(np.min(convergence.autocorrelation_times)), 1e-3)
    wanted = 1.1 * settings.autocorrelation_times / shortest
    return int(total * np.clip(wanted, 1.3, 2.5))
