"""Records in text files: csv with a `name [unit]` header, and odd ones described by a format."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import Faults, UserError
from deabayes.reading.cells import (
    DELIMITERS,
    is_number,
    refuse_skipped_data,
    sniff_decimal,
    split,
)
from deabayes.reading.columns import Column, Table, from_format, renamed
from deabayes.reading.header import read_header
from deabayes.reading.lines import (
    encoding_fault,
    last_line,
    open_text,
    peek,
    skip_lines,
    without_comments,
)

DELIMITER_NAMES = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", "": r"\s+", "space": r"\s+",
                   "comma": ",", "semicolon": ";"}  # fmt: skip
NO_DELIMITERS = ".+-#\"'\n\r"
MISSING = ("", *"nan NaN NAN -nan -NaN NA N/A n/a <NA> None null NULL".split())
"""Cells without a value."""
SNIFFED_LINES = 50


def read_text(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    named: Sequence[Column] | None = None,
) -> Table:
    """Read a delimited text file into columns as they are written.

    Parameters
    ----------
    record_format : `encoding`, `delimiter`, `header_lines` (lines that are not empty, above the
        data where there are `columns`, else above the header), `columns`, `decimal`; None for a
        file with a ``name [unit]`` header.
    named : names and units that experiments.csv gives to columns of this file.

    Raises
    ------
    UserError : empty file, undecodable header, wrong delimiter, ragged or truncated rows.
    """
    settings = dict(record_format or {})
    if faults := format_faults(settings, str(path)):
        raise Faults(faults)
    try:
        return _read(open_text(path, settings), path, settings, named)
    except csv.Error as error:
        raise UserError(
            f"{path}: is not a table of text ({error}); copy it again or export it as csv"
        ) from None


def _read(
    stream: io.BytesIO, path: Path, settings: Mapping[str, Any], named: Sequence[Column] | None
) -> Table:
    columns, delimiter = _columns(stream, path, settings, named)
    sample = peek(stream, SNIFFED_LINES)
    if not sample:
        raise UserError(f"{path}: holds no data rows after the header; copy the record again")
    last = last_line(stream)
    decimal = settings.get("decimal") or sniff_decimal([*sample, last], delimiter, path)
    _check_rows(path, len(columns), delimiter, sample[0], last)
    trailing = split(sample[0], delimiter)[len(columns) :]
    return _read_columns(stream, path, columns, delimiter, decimal, len(trailing))


def _columns(
    stream: io.BytesIO, path: Path, settings: Mapping[str, Any], named: Sequence[Column] | None
) -> tuple[list[Column], str]:
    """Columns and delimiter; the stream is left where the data begin."""
    columns = from_format(settings)
    delimiter = _named_delimiter(settings.get("delimiter"))
    header_lines = int(settings.get("header_lines", 0))
    if columns is None:
        return read_header(stream, path, header_lines, delimiter, named)
    skipped = skip_lines(stream, header_lines, path)
    delimiter = delimiter or _data_delimiter(peek(stream, 1), len(columns))
    refuse_skipped_data(split(skipped, delimiter), len(columns), path)
    return renamed(columns, named, str(path)), delimiter


def _data_delimiter(lines: Sequence[str], width: int) -> str:
    """The delimiter that splits the first data line into `width` cells."""
    marks = (*DELIMITERS, r"\s+")
    return next((m for m in marks if lines and len(split(lines[0], m)) == width), ",")


def format_faults(record_format: Mapping[str, Any] | None, where: str) -> list[str]:
    """What is wrong with the encoding and the delimiter that `record_format` states."""
    settings = dict(record_format or {})
    encoding = encoding_fault(str(settings.get("encoding", "utf-8")))
    faults = [f"{where}, record_format.encoding: {encoding}"] if encoding else []
    mark = _named_delimiter(settings.get("delimiter"))
    if mark not in (None, r"\s+") and (len(mark) > 1 or mark.isalnum() or mark in NO_DELIMITERS):
        faults.append(
            f"{where}, record_format.delimiter: {settings['delimiter']!r} separates no columns; "
            "give one character such as ',' or ';', or tab or whitespace"
        )
    return faults


def _named_delimiter(name: str | None) -> str | None:
    return None if name is None else DELIMITER_NAMES.get(name.strip(" ").lower(), name.strip(" "))


def _check_rows(path: Path, width: int, delimiter: str, first: str, last: str) -> None:
    """The first row matches the header and holds data; the last is not broken off."""
    found = split(first, delimiter)
    if found[width:] not in ([], [""]) or len(found) < width:
        raise UserError(
            f"{path}: {width} columns are named, but the first data row {first[:60]!r} "
            f"has {len(found)}; check the delimiter ({_describe(delimiter)}) and the header"
        )
    if len(split(last, delimiter)) < width:
        raise UserError(
            f"{path}: the last row {last[:60]!r} has {len(split(last, delimiter))} of {width} "
            "columns, the file is truncated; copy it again or remove that row"
        )
    if not any(is_number(cell) for cell in found):
        raise UserError(
            f"{path}: the first data row is {first[:60]!r}, which holds no number; correct "
            "the row, or the header (header_lines under record_format in specimen.yaml)"
        )


def _read_columns(
    stream: io.BytesIO,
    path: Path,
    columns: Sequence[Column],
    delimiter: str,
    decimal: str,
    trailing: int,
) -> Table:
    """Read the rest of the stream with pandas' C parser."""
    import pandas as pd

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                without_comments(stream), sep=delimiter, decimal=decimal, header=None,
                index_col=False, names=list(range(len(columns) + trailing)), skipinitialspace=True,
                keep_default_na=False, na_values=MISSING,
                encoding="utf-8", encoding_errors="replace", engine="c", low_memory=False,
            )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        detail = str(error).split("C error: ")[-1].strip().rstrip(".").lower()
        raise UserError(
            f"{path}: rows differ in their number of columns ({detail}; line 1 is the first "
            "data row); correct the row"
        ) from None
    arrays = [frame[index].to_numpy() for index in range(len(columns))]
    return Table(columns, arrays, decimal=decimal)


def _describe(delimiter: str) -> str:
    return {"\t": "tab", r"\s+": "white space"}.get(delimiter, delimiter)
