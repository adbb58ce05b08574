"""Draws that all records of a likelihood are simulated from, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, NoReturn, TypeVar

from deabayes.experiment import FloatArray
from deabayes.systems.base import Draws

Made = TypeVar("Made")


class Batch(dict[str, FloatArray]):
    """Draws by parameter name that stay as they are, and what systems have made of them."""

    def __init__(self, draws: Draws) -> None:
        super().__init__(draws)
        self.made: dict[Hashable, Any] = {}

    def __setitem__(self, name: str, values: FloatArray) -> NoReturn:
        raise TypeError("a batch of draws stays as it is; make another one")


def once(draws: Draws, key: Hashable, make: Callable[[], Made]) -> Made:
    """What `make` gives: for a `Batch` made once, however many records ask for it."""
    if not isinstance(draws, Batch):
        return make()
    if key not in draws.made:
        draws.made[key] = make()
    found: Made = draws.made[key]
    return found
