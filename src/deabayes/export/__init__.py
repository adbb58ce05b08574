"""Posterior draws in the formats other programs read: one file and one line here per format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr

from deabayes.faults import UserError, nearest
from deabayes.files import write_atomically
from deabayes.registry import load

REGISTRY: dict[str, Callable[[xr.DataTree, Path], None]] = load(
    __name__,
    {
        "csv": "write",
        "json": "write",
        "mat": "write",
    },
)
"""Format -> its function in the module of the same name."""


def export(tree: xr.DataTree, to: str, output: Path) -> None:
    """Write the posterior in `tree` to `output` in the format named `to`."""
    if to not in REGISTRY:
        raise UserError(f"--to {to!r} is no export format{nearest(to, REGISTRY)}")
    write_atomically(lambda path: REGISTRY[to](tree, path), Path(output))
