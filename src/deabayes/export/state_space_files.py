"""The two files of a state space: JSON and MATLAB."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

Content = Mapping[str, Any]


def write_json(content: Content, path: Path) -> None:
    """Arrays as nested lists, draws first; numbers with every digit they have."""
    text = json.dumps(content, default=lambda array: array.tolist(), allow_nan=False)
    path.write_text(text, encoding="utf-8")


def write_mat(content: Content, path: Path) -> None:
    """One struct `model`; draws last, so that ss(A, B, C, D) is an array of systems."""
    from scipy.io import savemat

    with path.open("wb") as stream:
        savemat(stream, {"model": _matlab(content)}, long_field_names=True)


def _matlab(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _matlab(held) for name, held in value.items()}
    if isinstance(value, list):
        cells = np.empty(len(value), dtype=object)
        cells[:] = [_matlab(held) for held in value]
        return cells
    return np.moveaxis(value, 0, -1) if isinstance(value, np.ndarray) and value.ndim else value


WRITERS: Mapping[str, Callable[[Content, Path], None]] = {".json": write_json, ".mat": write_mat}
"""Ending of the file -> what writes it."""
