"""Read records from MATLAB files, with helpers for all binary files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.faults import Report, UserError, nearest
from deabayes.records.columns import Column, Table

COMPLEX = ("real", "imag")
"""Fields of a complex number in version 7.3; arrays with other fields are structures."""


def read_mat(path: Path, columns: Sequence[Column] | None) -> Table:
    """Read the given columns from a MATLAB file, which stores no units."""
    variables, structures = _mat_variables(path)
    if not variables:
        remedy = f" but {_fields_wanted(structures)}" if structures else "; copy the record again"
        raise UserError(f"{path}: holds no variables{remedy}")
    if columns is None:
        raise UserError(
            f"{path}: a .mat file holds no units; name its variables ({', '.join(variables)}) in "
            "the `columns` column of experiments.csv, such as 't = time [s]; voltage [kV]', or "
            "under record_format.columns in specimen.yaml"
        )
    report = Report(str(path))
    table = pick(columns, variables, "variable", report)
    if report.faults and structures:
        report.fault(f"holds {_fields_wanted(structures)}")
    report.raise_faults()
    return table


def _fields_wanted(structures: Sequence[str]) -> str:
    return (
        f"structures ({', '.join(structures)}); save their fields as variables "
        f"(save('file.mat', '-struct', '{structures[0]}'))"
    )


def pick(
    columns: Sequence[Column], arrays: Mapping[str, NDArray[Any]], kind: str, report: Report
) -> Table:
    """Select the arrays that `columns` name; `kind` is the file format's word for an array."""
    if not arrays:
        report.fault(f"holds no {kind}s; copy the record again")
        return Table([], [])
    picked, values = [], []
    for column in columns:
        name = column.source or column.name
        if column.name in (None, "-") or name is None:
            continue
        if name not in arrays:
            report.fault(f"holds no {kind} {name!r}{nearest(name, arrays)}")
            continue
        picked.append(column)
        values.append(np.asarray(arrays[name]).ravel())
    lengths = {column.name: array.size for column, array in zip(picked, values, strict=True)}
    if len(set(lengths.values())) > 1:
        sizes = ", ".join(f"{name} {size}" for name, size in lengths.items())
        report.fault(f"the {kind}s differ in length ({sizes}); cut them to one length")
    if not values and not report.faults:
        report.fault(f"holds no {kind}s; copy the record again")
    return Table(picked, values)


def _mat_variables(path: Path) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return arrays by name, and the names of structures."""
    import h5py  # type: ignore[import-untyped,import-not-found,unused-ignore]
    import scipy.io

    if h5py.is_hdf5(path):  # version 7.3
        with opened(h5py.File, path, "a MATLAB file") as file:
            variables = {k: np.asarray(v) for k, v in file.items() if isinstance(v, h5py.Dataset)}
            names = [k for k in file if not k.startswith("#")]
    else:
        content = opened(scipy.io.loadmat, path, "a MATLAB file", squeeze_me=True)
        variables = {k: np.asarray(v) for k, v in content.items() if not k.startswith("__")}
        names = list(variables)
    arrays = {k: v for k, v in variables.items() if v.dtype.names in (None, COMPLEX)}
    return arrays, [k for k in names if k not in arrays]


def opened(opener: Any, path: Path, kind: str, **settings: Any) -> Any:
    """Call `opener(path)` and turn any error into a `UserError` about a damaged file."""
    if path.stat().st_size == 0:
        raise UserError(f"{path}: the file is empty; copy the record again")
    try:
        return opener(path, **settings)
    except Exception as error:
        raise UserError(
            f"{path}: cannot be read as {kind} ({str(error)[:80]}); "
            "copy it again or export it as csv"
        ) from None
