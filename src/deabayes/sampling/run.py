"""A chain of walkers that grows in checkpointed chunks and judges itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling import chains
from deabayes.sampling.checkpoint import Arrays, Store, random_state_arrays, random_state_from
from deabayes.sampling.cloud import LogDensity
from deabayes.sampling.diagnostics import LONG_ENOUGH, TAU_TOLERANCE
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.guide import NO_GUIDE, Guide
from deabayes.sampling.progress import progress_bar
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.smc import log_standard_normal
from deabayes.study import Sampling

MOST_STORED_STEPS = 4000
MINIMUM_STEPS = 1000
"""Just after the warm-up, effective sample sizes mostly count its independent particles."""
PATIENCE = 2000
"""Steps after which a run stops that is hopeless alone: proposals refitted to all runs make more
of the steps it is spared."""
HOPELESS = 2.0
"""Times the steps it may do are needed, by its autocorrelation time."""
DROPPED_SHARE = 0.2
MARGIN = 1.05
"""A run goes on a little beyond the wanted length, so that thinning does not undo it."""


def stage_seed(seed: np.random.SeedSequence, *stage: int) -> np.random.SeedSequence:
    """The random stream of a stage: depends on nothing but the seed and the stage."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *stage))


@dataclass
class Target:
    """log L(z) + log N(z; 0, I), counting evaluations and those that give no finite value.

    `guide` is what is known of it before.
    """

    likelihood: LogDensity
    guide: Guide = NO_GUIDE
    evaluations: int = 0
    failures: int = 0

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        values = np.asarray(self.likelihood(z), dtype=float)
        usable = np.isfinite(values)
        self.evaluations += len(values)
        self.failures += int((~usable).sum())
        return np.where(usable, values, -np.inf)

    def __call__(self, z: FloatArray) -> FloatArray:
        return self.log_likelihood(z) + log_standard_normal(z)

    def counted(self, compute: Callable[[], Arrays]) -> Arrays:
        """Add to a stage's result what it cost."""
        before = self.evaluations, self.failures
        result = compute()
        spent = [self.evaluations - before[0], self.failures - before[1]]
        return {**result, "evaluations": np.asarray(spent)}


@dataclass
class Run:
    """A chain that grows in chunks, each stored with all that is needed to go on from it."""

    target: Target
    proposal: Proposal
    start: tuple[FloatArray, FloatArray]
    seed: np.random.SeedSequence
    store: Store
    settings: Sampling
    label: str = "sampling"

    @property
    def thin(self) -> int:
        return -(-self.settings.max_steps // MOST_STORED_STEPS)

    @property
    def stored(self) -> int:
        """Stored steps, each `thin` steps of the sampler."""
        return sum(len(chunk["chain"]) for chunk in self.store.chunks())

    def advance(self, limit: int, may_stop: bool, progress: bool) -> None:
        """Sample to `limit` steps, or until a single run's gates pass or clearly never will."""
        from deabayes.sampling.moves import build_sampler

        sampler = build_sampler(self.target, self.proposal, self.start[0].shape, self.target.guide)
        goal = self._goal(limit)
        with progress_bar(
            progress,
            total=goal * self.thin,
            initial=self.stored * self.thin,
            desc=self.label,
            unit="step",
        ) as bar:
            while (done := self.stored) < goal and not (may_stop and self._decided()):
                length = min(max(-(-100 // self.thin), int(0.15 * done)), goal - done)
                chunk = self.target.counted(lambda n=length: self._chunk(sampler, n, bar))  # type: ignore[misc]
                chunk |= self._check(chunk["chain"], goal)
                self.store.append(chunk)
                times, rank = float(chunk["times"]), float(chunk["r_hat"])
                far = f"{times:.0f} autocorrelation times, R-hat {rank:.3f}"
                bar.set_postfix_str(far, refresh=False)

    def _decided(self) -> bool:
        chunks = self.store.chunks()
        return bool(chunks and (chunks[-1]["enough"] or chunks[-1]["hopeless"]))

    def _chunk(self, sampler: Any, length: int, bar: Any) -> Arrays:
        from deabayes.sampling.moves import initial_state

        chunks = self.store.chunks()
        if chunks:
            last = chunks[-1]
            state = initial_state(last["chain"][-1], last["log_posterior"][-1], self.seed)
            state.random_state = random_state_from(last)
        else:
            state = initial_state(*self.start, self.seed)
        sampler.reset()
        steps = sampler.sample(
            state, iterations=length, thin_by=self.thin, skip_initial_state_check=True
        )
        for after in steps:
            bar.update(self.thin)
            state = after
        return {
            "chain": sampler.get_chain().copy(),
            "log_posterior": sampler.get_log_prob().copy(),
            "accepted": np.asarray(sampler.backend.accepted.mean()),
            **random_state_arrays(state.random_state),
        }

    def _check(self, newest: FloatArray, goal: int) -> Arrays:
        """The gates that one run can be judged by, on all steps but the first fifth."""
        chunks = self.store.chunks()
        steps = sum(len(chunk["chain"]) for chunk in chunks) + len(newest)
        result = {"times": np.nan, "tau": np.nan, "r_hat": np.nan, "enough": False}
        if steps * self.thin >= min(MINIMUM_STEPS, goal * self.thin) and steps >= 20:
            chain = np.concatenate([*(chunk["chain"] for chunk in chunks), newest])
            kept = chain[int(DROPPED_SHARE * steps) :]
            kept = kept[chains.thin_evenly(len(kept), 250)]
            before = float(chunks[-1]["tau"]) if chunks else np.nan
            span = (steps - int(DROPPED_SHARE * steps)) * self.thin
            result = self._gates(kept, span, before)
        needed = MARGIN * self.settings.autocorrelation_times * result["tau"]
        far_from_it = needed > HOPELESS * goal * self.thin
        result["hopeless"] = far_from_it and steps * self.thin >= PATIENCE
        return {name: np.asarray(value) for name, value in result.items()}

    def _gates(self, kept: FloatArray, span: int, before: float) -> dict[str, float]:
        coordinates = np.moveaxis(kept, 2, 0)[:, None]
        smallest = min(chains.ess_bulk(values) for values in coordinates)
        times = smallest / kept.shape[1]
        tau = span / times
        wanted = self.settings.autocorrelation_times
        enough = (
            times >= MARGIN * wanted
            and smallest >= self.settings.ess
            and (abs(tau / before - 1) <= TAU_TOLERANCE or times >= LONG_ENOUGH * wanted)
        )
        rank = max(chains.r_hat(values[:, ::2]) for values in coordinates)
        enough = enough and rank < self.settings.r_hat
        return {"times": times, "tau": tau, "r_hat": rank, "enough": enough}

    def ensemble(
        self,
        dropped: float,
        replaced_walkers: int,
        evaluations: FloatArray,
        steps_before: int = 0,
        refitted: bool = False,
        limit: int | None = None,
        thin: int | None = None,
    ) -> Ensemble:
        """What is kept of the chain so far: spaced by `thin`, or a quarter of its
        autocorrelation time.

        Only the first `limit` steps are looked at: what a run that was stopped had done after
        them must not decide how it goes on.
        """
        chunks = self._chunks_to(limit)
        chain = np.concatenate([chunk["chain"] for chunk in chunks])
        first = int(dropped * len(chain))
        tau, kept = float(chunks[-1]["tau"]), len(chain) - first
        wanted = int(tau / self.thin / 4) if np.isfinite(tau) else 1
        stride = max(1, min(wanted, kept // 200)) if thin is None else thin // self.thin
        index = np.arange(len(chain) - 1, first - 1, -stride)[::-1]
        spent = evaluations + sum(chunk["evaluations"] for chunk in chunks)
        return Ensemble(
            chain=chain[index],
            log_posterior=np.concatenate([chunk["log_posterior"] for chunk in chunks])[index],
            proposal=self.proposal,
            steps=steps_before + len(chain) * self.thin,
            burn_in=steps_before + first * self.thin,
            thin=stride * self.thin,
            acceptance=float(sum(chunk["accepted"] for chunk in chunks) / len(chain)),
            autocorrelation_time=tau,
            replaced_walkers=replaced_walkers,
            evaluations=int(spent[0]),
            failures=int(spent[1]),
            enough=bool(chunks[-1]["enough"]),
            refitted=refitted,
        )

    def _chunks_to(self, limit: int | None) -> list[Arrays]:
        """The chunks that `advance` made on its way to `limit` steps, or all of them."""
        chunks = self.store.chunks()
        if limit is None:
            return chunks
        ends = np.cumsum([len(chunk["chain"]) for chunk in chunks])
        return chunks[: int(np.searchsorted(ends, self._goal(limit))) + 1]

    def _goal(self, limit: int) -> int:
        return max(limit // self.thin, 1)
