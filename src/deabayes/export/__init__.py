"""Posterior draws in the formats other programs read: one file and one line here per format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr

from deabayes.export import csv, json, mat
from deabayes.faults import UserError, nearest
from deabayes.files import write_atomically

REGISTRY: dict[str, Callable[[xr.DataTree, Path], None]] = {
    "csv": csv.write,
    "json": json.write,
    "mat": mat.write,
}


def export(tree: xr.DataTree, to: str, output: Path) -> None:
    """Write the posterior in `tree` to `output` in the format named `to`."""
    if to not in REGISTRY:
        raise UserError(f"--to {to!r} is no export format{nearest(to, REGISTRY)}")
    write_atomically(lambda path: REGISTRY[to](tree, path), Path(output))
