"""Export of draws as CSV, JSON, MATLAB and Parquet files."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from deabayes.export.source import converged, identity, units
from deabayes.faults import UserError
from deabayes.posteriors.storage import stacked

LONGEST_NAME = 63
"""Most characters of a name in MATLAB."""


def draws_table(tree: xr.DataTree) -> pd.DataFrame:
    """Tabulate all draws, one ensemble after the other; a column holds the ensemble's number."""
    group = tree["posterior"]
    table = pd.DataFrame({str(name): stacked(group, str(name)) for name in group.data_vars})
    table.insert(0, "ensemble", np.repeat(np.arange(group.sizes["chain"]), group.sizes["draw"]))
    return table


def write_csv(tree: xr.DataTree, path: Path) -> None:
    """Write one row per draw; columns of quantities are named `name [unit]`, SI.

    The columns `ensemble`, `simulated` (from simulated records) and `converged` have no unit. The
    last two are 1 or 0 in every row, because all programs can read numbers: some would read a
    comment above the header as data, and some cannot read text in a column.
    """
    names = {name: f"{name} [{unit}]" for name, unit in units(tree).items()}
    table = draws_table(tree).rename(columns=names)
    table["simulated"] = int(tree.attrs["provenance"] == "simulated")
    table["converged"] = int(converged(tree))
    table.to_csv(path, index=False)


def write_json(tree: xr.DataTree, path: Path) -> None:
    """Write `{candidate, system, ..., converged, parameters: {name: {unit, symbol, draws}}}`.

    A value that is not finite becomes null, since JSON has neither NaN nor infinity.
    """
    table = draws_table(tree)
    parameters = {
        str(name): {
            "unit": variable.attrs.get("unit", "1"),
            "symbol": variable.attrs.get("symbol", ""),
            "kind": variable.attrs.get("kind", ""),
            "draws": [
                value if math.isfinite(value) else None for value in table[str(name)].tolist()
            ],
        }
        for name, variable in tree["posterior"].data_vars.items()
    }
    content = {
        **identity(tree),
        "converged": converged(tree),
        "ensemble": table["ensemble"].tolist(),
        "parameters": parameters,
    }
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def write_mat(tree: xr.DataTree, path: Path) -> None:
    """Write the structs `draws`, `units`, `names` and `about`.

    The fields of the first three have names that MATLAB allows (see `matlab_fields`). `about` holds
    `candidate`, `system`, `provenance`, `deabayes_version` and the logical `converged`.

    Raises
    ------
    UserError : a name longer than MATLAB allows.
    """
    from scipy.io import savemat

    table = draws_table(tree)
    field_of = matlab_fields([str(name) for name in table.columns])
    content = {
        "draws": {field: table[name].to_numpy() for name, field in field_of.items()},
        "units": {field_of[name]: unit for name, unit in units(tree).items()},
        "names": {field: name for name, field in field_of.items()},
        "about": {**identity(tree), "converged": converged(tree)},
    }
    with path.open("wb") as stream:
        savemat(stream, content, long_field_names=True)


def matlab_fields(names: Sequence[str]) -> dict[str, str]:
    """Map quantities to MATLAB fields: `__` for a dot, `_` for other signs, `x` before a digit.

    If several names become the same field, the later ones get the endings `_1`, `_2`, as with
    MATLAB's `makeUniqueStrings`.

    Raises
    ------
    UserError : a field is longer than MATLAB allows.
    """
    field_of: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name.replace(".", "__"), flags=re.ASCII)
        plain = plain if plain[0].isalpha() else f"x{plain}"
        choices = itertools.chain([plain], (f"{plain}_{k}" for k in itertools.count(1)))
        field_of[name] = next(field for field in choices if field not in field_of.values())
        if len(field_of[name]) > LONGEST_NAME:
            raise UserError(
                f"{name}: MATLAB allows names of at most {LONGEST_NAME} characters; export with "
                "--to csv or --to json"
            )
    return field_of


def write_parquet(tree: xr.DataTree, path: Path) -> None:
    """Write one row per draw, with a column `ensemble` and one column per quantity.

    `pandas.read_parquet` reads the file. Every column except `ensemble` has the metadata `unit`
    (SI) and `symbol`. The table has the metadata `candidate`, `system`, `provenance`,
    `deabayes_version` and `converged` (`true` or `false`).
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.Table.from_pandas(draws_table(tree), preserve_index=False)
    variables = tree["posterior"].data_vars
    fields = [
        field.with_metadata(
            {name: str(variables[field.name].attrs.get(name, "")) for name in ("unit", "symbol")}
        )
        if field.name in variables
        else field
        for field in table.schema
    ]
    metadata = {
        **(table.schema.metadata or {}),
        **identity(tree),
        "converged": json.dumps(converged(tree)),
    }
    pq.write_table(table.cast(pa.schema(fields, metadata=metadata)), path)
