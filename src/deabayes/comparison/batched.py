"""A vectorised likelihood for a sampler that asks for one point at a time, in many chains.

dynesty hands chains to a pool, each a plain function that calls the likelihood point by
point. Here every chain of a batch runs in a thread and waits at its call until all of them
wait; the last one evaluates all points at once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from deabayes.experiment import FloatArray


class Batched:
    """A pool (`map`, `size`) and a likelihood of one point, together.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,).
    size : chains that run at once.
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
        """The likelihood of one point z (d,), called inside `map` or outside."""
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
