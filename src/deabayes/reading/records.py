"""One record, whatever file it comes in, as columns in SI units."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import UserError
from deabayes.reading.binary import read_mat
from deabayes.reading.columns import CHANNELS, Column, Table, from_format, to_record
from deabayes.reading.excel import read_xlsx
from deabayes.reading.raw import RawRecord
from deabayes.reading.tdms import read_tdms
from deabayes.reading.text import read_text


def read_record(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    channels: Mapping[str, str] | None = None,
    columns: Sequence[Column] | None = None,
) -> RawRecord:
    """Read a record and convert its columns to SI units.

    Parameters
    ----------
    path : .csv (or other text), .xlsx, .mat or .tdms.
    record_format : `record_format` of specimen.yaml, for files without a ``name [unit]`` header.
    channels : known channels and their SI units; default `CHANNELS`.
    columns : names and units that experiments.csv gives to columns of this record; of a .mat or
        .tdms file those to read, before those of `record_format`.

    Raises
    ------
    Faults, UserError : whatever keeps the file from being read, naming file and column.
    """
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{path}: is a folder; name the file of the record")
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; correct the path")
    try:
        table = _read_table(path, record_format, columns)
        return to_record(table, sha256_of(path), channels or CHANNELS, str(path))
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror or error})") from None


def sha256_of(path: Path) -> str:
    """SHA-256 of the raw file, as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _read_table(
    path: Path, record_format: Mapping[str, Any] | None, columns: Sequence[Column] | None
) -> Table:
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
        case _:
            return read_text(path, record_format, columns)
