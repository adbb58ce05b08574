"""Read records from MATLAB files, with helpers for all binary files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.faults import Report, UserError, nearest
from deabayes.records.columns import Column, Table

COMPLEX = ("real", "imag")
"""Fields of a complex number in version 7.3; arrays with other fields are structures."""


def read_mat(path: Path, columns: Sequence[Column] | None) -> Table:
    """Read the given columns from a MATLAB file, which stores no units; by default all of them.

    Fields of structures and columns of matrices are named as in MATLAB: ``run.t``, ``data(:,2)``,
    ``rec.Y(2).Data``.
    """
    variables = _mat_variables(path)
    if not variables:
        raise UserError(f"{path}: holds no variables; copy the record again")
    if columns is None:  # their units are asked for
        columns = [
            Column(name, None)
            for name, values in variables.items()
            if values.size > 1 and values.dtype.kind in "fiu"
        ]
        return Table(columns, [variables[column.name or ""] for column in columns])
    report = Report(str(path))
    table = pick(columns, variables, "variable", report)
    report.raise_faults()
    return table


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
            parts = ", ".join(part for part in arrays if part.startswith((f"{name}(", f"{name}.")))
            hint = f" but {parts}; name one of them" if parts else nearest(name, arrays)
            report.fault(f"holds no {kind} {name!r}{hint}")
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


def _mat_variables(path: Path) -> dict[str, NDArray[Any]]:
    """Return arrays by name."""
    import h5py  # type: ignore[import-untyped,import-not-found,unused-ignore]
    import scipy.io

    if h5py.is_hdf5(path):  # version 7.3
        with opened(h5py.File, path, "a MATLAB file") as file:
            content = [
                pair for name in file if name != "#refs#" for pair in _read(name, file[name])
            ]
    else:
        loaded = opened(scipy.io.loadmat, path, "a MATLAB file", squeeze_me=True)
        content = [(name, values) for name, values in loaded.items() if not name.startswith("__")]
    return {name: array for pair in content for name, array in _arrays(*pair)}


def _read(name: str, item: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of a variable of version 7.3, which stores them transposed."""
    if hasattr(item, "items"):  # a structure
        for field, value in item.items():
            yield from _read(f"{name}.{field}", value)
    else:
        yield name, np.asarray(item).T.squeeze()


def _arrays(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of a variable: fields of a structure, columns of a matrix."""
    array = np.asarray(value)
    if array.dtype.names not in (None, COMPLEX):
        elements = array.reshape(-1)
        for index, element in enumerate(elements, start=1):
            whole = name if elements.size == 1 else f"{name}({index})"
            for field in array.dtype.names or ():
                yield from _arrays(f"{whole}.{field}", element[field])
    elif array.ndim == 2 and min(array.shape) > 1:
        for column in range(array.shape[1]):
            yield f"{name}(:,{column + 1})", array[:, column]
    else:
        yield name, array


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
