"""Draws that all records of a likelihood are simulated from, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from typing import Any, TypeVar

from deabayes.experiment import FloatArray
from deabayes.systems.base import Draws

Made = TypeVar("Made")


class Batch(Mapping[str, FloatArray]):
    """Draws by parameter name that stay as they are, and what systems have made of them."""

    def __init__(self, draws: Draws) -> None:
        self._draws = dict(draws)
        self.made: dict[Hashable, Any] = {}

    def __getitem__(self, name: str) -> FloatArray:
        return self._draws[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._draws)

    def __len__(self) -> int:
        return len(self._draws)


def once(draws: Draws, key: Hashable, make: Callable[[], Made]) -> Made:
    """What `make` gives: for a `Batch` made once, however many records ask for it."""
    if not isinstance(draws, Batch):
        return make()
    if key not in draws.made:
        draws.made[key] = make()
    found: Made = draws.made[key]
    return found
