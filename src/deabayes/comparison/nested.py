"""Evidence by nested sampling, independent of the project's own sampler."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from scipy.special import ndtri

from deabayes.experiment import FloatArray
from deabayes.faults import UserError


class Batched:
    """A thread pool and a likelihood of one point that evaluates waiting points in one batch.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,).
    size : number of chains that run at once.
    """

    def __init__(self, log_likelihood: Callable[[FloatArray], FloatArray], size: int) -> None:
        self.log_likelihood = log_likelihood
        self.size = size
        self.evaluations, self.batches = 0, 0
        self._threads = ThreadPoolExecutor(size)
        self._changed = threading.Condition()
        self._running = 0
        self._waiting: list[tuple[FloatArray, list[float]]] = []

    def map(self, function: Callable[[Any], Any], arguments: Iterable[Any]) -> list[Any]:
        """Apply a function to every argument, at most `size` at a time."""
        everything = list(arguments)
        results: list[Any] = []
        for first in range(0, len(everything), self.size):
            batch = everything[first : first + self.size]
            self._running = len(batch)
            futures = [self._threads.submit(self._chain, function, each) for each in batch]
            results += [future.result() for future in futures]
        return results

    def __call__(self, z: FloatArray) -> float:
        """Return the log-likelihood of one point z (d,), inside a call of `map` or outside."""
        if not self._running:
            return self._evaluate([z])[0]
        answer: list[float] = []
        with self._changed:
            self._waiting.append((np.array(z), answer))
            self._evaluate_if_all_wait()
            self._changed.wait_for(lambda: bool(answer))
        return answer[0]

    def _chain(self, function: Callable[[Any], Any], argument: Any) -> Any:
        try:
            return function(argument)
        finally:
            with self._changed:
                self._running -= 1
                self._evaluate_if_all_wait()

    def _evaluate_if_all_wait(self) -> None:
        if not self._waiting or len(self._waiting) < self._running:
            return
        values = self._evaluate([z for z, _ in self._waiting])
        for (_, answer), value in zip(self._waiting, values, strict=True):
            answer.append(value)
        self._waiting = []
        self._changed.notify_all()

    def _evaluate(self, points: list[FloatArray]) -> list[float]:
        self.evaluations += len(points)
        self.batches += 1
        return [float(v) for v in self.log_likelihood(np.stack(points))]


LIVE, CHAINS, REMAINING = 500, 32, 0.01
"""Live points, chains that move at once, and the remaining log evidence at which sampling ends."""


def nested(
    log_likelihood: Callable[[FloatArray], FloatArray],
    dimension: int,
    seed: np.random.SeedSequence,
    live: int = LIVE,
) -> tuple[Any, float]:
    """Run dynesty in z; return its results and the CPU seconds they took.

    The method is that of Skilling 2006 (10.1214/06-BA127), implemented by Speagle 2020
    (10.1093/mnras/staa278), with random slices. The prior of every coordinate of z is standard
    normal. The prior transform is therefore the normal quantile, and the integral of the
    likelihood over this prior is the evidence.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,); -inf where the likelihood cannot be computed.

    Raises
    ------
    UserError : dynesty is not installed.
    """
    try:
        from dynesty import NestedSampler
    except ImportError:
        raise UserError(
            "evidence_check: nested needs the package dynesty; `pip install '.[nested]'`, "
            "or leave the check out"
        ) from None
    began = time.process_time()
    batched = Batched(log_likelihood, max(min(CHAINS, live // 4), 1))
    sampler = NestedSampler(
        batched, ndtri, dimension, nlive=live, sample="rslice",
        rstate=np.random.default_rng(seed), pool=batched, queue_size=batched.size,
        use_pool={"prior_transform": False, "update_bound": False},
    )  # fmt: skip
    sampler.run_nested(dlogz=REMAINING, print_progress=False)
    return sampler.results, time.process_time() - began
