"""Find one record, and read it from any supported file into columns in SI units."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import Report, UserError
from deabayes.integrate.periodic import roughness
from deabayes.quantities import with_unit
from deabayes.records.channels import excitation_range
from deabayes.records.columns import (
    CHANNELS,
    Column,
    ExperimentRow,
    RawRecord,
    Table,
    from_format,
)
from deabayes.records.conversion import to_record
from deabayes.records.excel import read_xlsx
from deabayes.records.labview import is_labview, read_labview
from deabayes.records.matlab import read_mat
from deabayes.records.tdms import read_tdms
from deabayes.records.text import read_text

VARIABLE = "DEABAYES_DATA"
REMEDY = "or have such rows left out: record_format: {incomplete_rows: drop} in specimen.yaml"
MISSED = 0.01
"""Largest deviation that left-out rows may hide, as a share of the excitation's range."""
OVER_NOISE = 8.0
"""Largest distance of a left-out row from the line over it, in standard deviations of noise."""


def roots(download: Mapping[str, str], data_root: Path | None = None) -> list[Path]:
    """Folders that may hold a data set, in order: $DEABAYES_DATA, `data_root`, pooch's cache."""
    stated = [os.environ.get(VARIABLE), data_root]
    local = [Path(root) / download["folder"] for root in stated if root]
    return [*local, cache_folder() / download["folder"]]


def cache_folder() -> Path:
    """Folder for downloaded data on this machine."""
    import pooch

    return Path(pooch.os_cache("deabayes"))


def locate(
    record: str,
    folder: Path,
    download: Mapping[str, str] | None = None,
    data_root: Path | None = None,
) -> Path | None:
    """Return the record's file, in the study folder or one of the `roots`; None if not found."""
    places = [Path(folder), *(roots(download, data_root) if download else [])]
    return next((place / record for place in places if (place / record).is_file()), None)


def read_record(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    channels: Mapping[str, str] | None = None,
    columns: Sequence[Column] | None = None,
    needed: Sequence[str] | None = None,
) -> RawRecord:
    """Read a record and convert its columns to SI units.

    Parameters
    ----------
    path : .csv (or other text), .xlsx, .mat or .tdms.
    record_format : `record_format` of specimen.yaml, for files without a ``name [unit]`` header.
    channels : known channels and their SI units; default `CHANNELS`.
    columns : names and units that experiments.csv gives to columns of this record. For a .mat or
        .tdms file they are the columns to read, with priority over `record_format`.
    needed : channels that the record must have. Other columns that cannot be read are then left
        out. None requires every known channel to be sound.

    Raises
    ------
    Faults, UserError : the file cannot be read; the message names file and column.
    """
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{path}: is a folder; name the file of the record")
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; correct the path")
    try:
        table = read_table_of(path, record_format, columns)
        return to_record(table, sha256_of(path), channels or CHANNELS, str(path), needed)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror or error})") from None


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_table_of(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    columns: Sequence[Column] | None = None,
) -> Table:
    """Read a record's columns without converting them; parameters as for `read_record`."""
    named = columns if columns is not None else from_format(record_format)
    match path.suffix.lower():
        case ".xlsx" | ".xlsm":
            return read_xlsx(path, record_format, columns)
        case ".mat":
            return read_mat(path, named)
        case ".tdms":
            return read_tdms(path, named)
        case ".xls":
            raise UserError(f"{path}: old Excel files cannot be read; save it as .xlsx or csv")
        case _ if from_format(record_format) is None and is_labview(path):
            return read_labview(path, record_format, columns)
        case _:
            return read_text(path, record_format, columns)


def without_incomplete(raw: RawRecord, needed: Sequence[str]) -> RawRecord:
    """Remove rows that lack a needed value or repeat the time of the row before.

    The first complete row of each time stamp stays. `left_out` counts the removed rows. A record
    without a needed column, or with an empty one, is returned unchanged.
    """
    kept = _complete(raw, needed)
    if kept.all():
        return raw
    columns = {name: values[kept] for name, values in raw.columns.items()}
    return replace(raw, columns=columns, left_out=int(kept.size - kept.sum()))


def hidden_excitation(
    row: ExperimentRow,
    raw: RawRecord,
    needed: Sequence[str],
    before: float | None,
    report: Report,
) -> None:
    """Report rows to be left out if they hold excitation that the line over them misses.

    Rows after the last complete row do not matter: they drive no response that is kept.

    Parameters
    ----------
    row, raw : a record with all its rows.
    needed : columns in which a complete row has a value.
    before : excitation assumed before the first complete row; None takes its value there.
    """
    kept = _complete(raw, needed)
    if kept.all() or "time" not in needed:
        return
    off, allowed = _off_the_line(row, raw, kept, before)
    if not np.any(off > allowed):
        return
    name, response = row.excitation, row.response
    first, last = _run(kept, int(np.argmax(off > allowed)))
    missed = with_unit(float(off[first : last + 1].max()), raw.units[name], name, digits=3)
    rows = f"data row {first + 1}" if first == last else f"data rows {first + 1} to {last + 1}"
    report.fault(
        f"{rows}, without {response}, cannot be left out (record_format.incomplete_rows): the "
        f"{name} measured there is up to {missed} off the line between the rows that are kept; "
        f"fill in the {response} of a row beside them and hide it with the preparation step "
        "`mask_between`, let the record end before them, or begin behind them at rest",
        f"column {name}",
    )


def _off_the_line(
    row: ExperimentRow, raw: RawRecord, kept: NDArray[np.bool_], before: float | None
) -> tuple[FloatArray, float]:
    """Distance of the measured excitation from the line over the kept rows, and its limit."""
    time, excitation = raw.columns["time"], raw.columns[row.excitation]
    if not kept.any() or np.any(np.diff(time[kept]) < 0.0):
        return np.zeros(kept.size), 0.0  # the checks of the kept rows report this
    measured = np.isfinite(time) & np.isfinite(excitation)
    between = measured & (time < time[kept][-1]) & ~np.isin(time, time[kept])
    line = np.interp(time, time[kept], excitation[kept], left=before)
    known = excitation[measured]
    size = excitation_range(row.protocol, known, raw.units[row.excitation])
    off = np.where(between, np.abs(excitation - line), 0.0)
    return off, max(MISSED * size, OVER_NOISE * roughness(known))


def _run(kept: NDArray[np.bool_], at: int) -> tuple[int, int]:
    """First and last index of the run of left-out rows that contains `at`."""
    places = np.flatnonzero(kept)
    behind = int(np.searchsorted(places, at))
    first = int(places[behind - 1]) + 1 if behind else 0
    return first, int(places[behind]) - 1 if behind < places.size else kept.size - 1


def _complete(raw: RawRecord, needed: Sequence[str]) -> NDArray[np.bool_]:
    """Flag the rows that stay: all of them if a needed column is missing or empty."""
    every = np.ones(next((v.size for v in raw.columns.values()), 0), dtype=bool)
    if not set(needed) <= set(raw.columns):
        return every
    known = np.array([np.isfinite(raw.columns[name]) for name in needed])
    if not known.any(axis=1).all():
        return every
    kept = np.asarray(known.all(axis=0))
    if "time" in needed:
        places = np.flatnonzero(kept)
        again = np.diff(raw.columns["time"][places]) == 0.0
        kept[places[1:][again]] = False
    return kept
