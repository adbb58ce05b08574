"""Draws as JSON with units, symbols and provenance."""

from __future__ import annotations

import json
import math
from pathlib import Path

import xarray as xr

from deabayes.export.taken import converged, draws_table, stated


def write(tree: xr.DataTree, path: Path) -> None:
    """`{candidate, system, provenance, converged, parameters: {name: {unit, symbol, draws}}}`.

    A draw that is not finite is null: JSON has no NaN and no infinity.
    """
    table = draws_table(tree)
    parameters = {
        str(name): {
            "unit": variable.attrs.get("unit", "1"),
            "symbol": variable.attrs.get("symbol", ""),
            "kind": variable.attrs.get("kind", ""),
            "draws": [each if math.isfinite(each) else None for each in table[str(name)].tolist()],
        }
        for name, variable in tree["posterior"].data_vars.items()
    }
    content = {
        **stated(tree),
        "converged": converged(tree),
        "ensemble": table["ensemble"].tolist(),
        "parameters": parameters,
    }
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")
