"""Checkpoints that survive a kill at any moment: files appear complete or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.files import write_atomically

Arrays = dict[str, NDArray[Any]]


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays to `path` (npz): the file appears complete or not at all."""

    def save(place: Path) -> None:
        with place.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    write_atomically(save, path)


def read_arrays(path: Path) -> Arrays | None:
    """Read named arrays; None when the file is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except Exception:  # a damaged header can raise many kinds of exceptions
        return None


class Store:
    """A folder of checkpoints; if `folder` is None, only chunks are kept, in memory.

    Single results are stored by name. Chunks of a chain are appended in order, and each chunk is
    one file that never changes. A damaged or missing chunk ends the sequence.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._chunks: list[Arrays] | None = None

    def sub(self, name: str) -> Store:
        """Return a store in a subfolder of this store."""
        return Store(None if self.folder is None else self.folder / name)

    def once(self, name: str, compute: Callable[[], Arrays]) -> Arrays:
        """Return the stored result `name`; compute and store the result if it is missing."""
        if self.folder is None:
            return compute()
        path = self.folder / f"{name}.npz"
        stored = read_arrays(path)
        if stored is None:
            stored = compute()
            write_arrays(path, stored)
        return stored

    def chunks(self) -> list[Arrays]:
        """Return all chunks stored so far, in order."""
        if self._chunks is None:
            self._chunks = []
            while self.folder is not None:
                chunk = read_arrays(self._chunk_path(len(self._chunks)))
                if chunk is None:
                    break
                self._chunks.append(chunk)
        return self._chunks

    def append(self, chunk: Arrays) -> None:
        """Add the next chunk."""
        chunks = self.chunks()
        if self.folder is not None:
            write_arrays(self._chunk_path(len(chunks)), chunk)
        chunks.append(chunk)

    def _chunk_path(self, index: int) -> Path:
        assert self.folder is not None
        return self.folder / f"chunk_{index:05d}.npz"


def random_state_arrays(state: tuple[Any, ...]) -> Arrays:
    """Return the state of a Mersenne Twister `RandomState` as arrays."""
    _, key, position, has_gauss, cached = state
    return {
        "random_key": np.asarray(key),
        "random_position": np.asarray([position, has_gauss]),
        "random_cached": np.asarray(cached),
    }


def random_state_from(arrays: Mapping[str, NDArray[Any]]) -> tuple[Any, ...]:
    """Invert `random_state_arrays`; return a state for `RandomState.set_state`."""
    position, has_gauss = (int(value) for value in arrays["random_position"])
    return ("MT19937", arrays["random_key"], position, has_gauss, float(arrays["random_cached"]))
