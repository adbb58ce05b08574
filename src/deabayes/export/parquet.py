"""Draws as Parquet: plain names, units and provenance in the file's metadata."""

from __future__ import annotations

import json
from pathlib import Path

import xarray as xr

from deabayes.export.taken import converged, draws_table, stated


def write(tree: xr.DataTree, path: Path) -> None:
    """One row per draw, one column per quantity, and `ensemble`; read by `pandas.read_parquet`.

    Metadata of every column but `ensemble`: `unit` (SI) and `symbol`; of the table: `candidate`,
    `system`, `provenance`, `deabayes_version`, and `converged`, which is `true` or `false`.
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
    told = stated(tree) | {"converged": json.dumps(converged(tree))}
    kept = {key.decode(): value for key, value in (table.schema.metadata or {}).items()}
    pq.write_table(table.cast(pa.schema(fields, metadata={**kept, **told})), path)
