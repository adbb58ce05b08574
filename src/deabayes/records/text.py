"""Read records from text files, with `name [unit]` headers or described by a format."""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import Faults, UserError
from deabayes.records.columns import (
    CHANNELS,
    Column,
    Table,
    from_format,
    from_header,
    renamed,
    unit_hint,
)
from deabayes.records.lines import (
    DELIMITERS,
    encoding_fault,
    is_number,
    last_line,
    lines,
    open_text,
    peek,
    refuse_skipped_data,
    skip_lines,
    sniff_decimal,
    sniff_delimiter,
    split,
    without_comments,
)

NAME_AND_UNIT = re.compile(r"\w+ *\[[^\[\]]*\]")


def read_header(
    stream: io.BytesIO,
    path: Path,
    header_lines: int,
    delimiter: str | None,
    named: Sequence[Column] | None,
) -> tuple[list[Column], str]:
    """Return columns and delimiter, and leave the stream where the data begin.

    Parameters
    ----------
    header_lines : number of non-empty lines above the header.
    delimiter : None to detect it.
    named : names and units that experiments.csv gives to columns of the header.
    """
    above = skip_lines(stream, header_lines, path)
    header = _header_line(stream, path)
    marks = DELIMITERS if delimiter is None else (delimiter,)
    if any(all(map(is_number, split(header, mark))) for mark in marks):
        raise UserError(f"{path}: starts with numbers ({header[:40]!r}) where a header such as "
                        f"'time [s],voltage [kV]' is needed; {_remedy(stream, above)}")  # fmt: skip
    delimiter = delimiter or sniff_delimiter(header)
    cells = split(header, delimiter)
    columns = renamed(from_header(cells), named, str(path))
    _check_columns(columns, cells, header, path)
    if columns[-1].name is None:
        columns.pop()  # the header ends with a delimiter
    return columns, delimiter


def _remedy(stream: io.BytesIO, above: str) -> str:
    """Say what to do if the line just read is no header; `above` is the last skipped line."""
    comment = _line_before(stream)
    if comment.startswith("#") and NAME_AND_UNIT.search(comment):
        return f"remove the '#' before {comment.lstrip('# ')[:40]!r}"
    if not above:
        return "add it, or describe the columns under record_format in specimen.yaml"
    return (
        f"header_lines under record_format in specimen.yaml, which counts the lines above the "
        f"header where no `columns` are given, ends with {above[:40]!r}; state fewer, or `columns`"
    )


def _line_before(stream: io.BytesIO) -> str:
    """Return the non-empty line above the one just read."""
    read = stream.getvalue()[: stream.tell()].removeprefix(codecs.BOM_UTF8)
    filled = [line.strip() for line in read.splitlines() if line.strip()]
    return filled[-2].decode("utf-8", errors="replace") if len(filled) > 1 else ""


def _header_line(stream: io.BytesIO, path: Path) -> str:
    for _, line in lines(stream):
        try:
            return line.decode("utf-8")
        except UnicodeDecodeError as error:
            number = stream.getvalue()[: stream.tell()].rstrip(b"\n").count(b"\n") + 1
            raise UserError(
                f"{path}, line {number}: the header is not UTF-8 (byte 0x{line[error.start]:02x}); "
                "save the file as UTF-8, or give its encoding in specimen.yaml, such as "
                "record_format: {encoding: latin-1}"
            ) from None
    raise UserError(f"{path}: holds nothing but empty lines and comments; copy the record again")


def _check_columns(columns: list[Column], cells: list[str], header: str, path: Path) -> None:
    if len(columns) == 1 and not NAME_AND_UNIT.fullmatch(header.strip()):
        raise UserError(
            f"{path}: only one column found in the header {header[:60]!r}; "
            "separate columns with a comma, ';' or a tab"
        )
    if all(column.unit is None for column in columns):
        hint = unit_hint(cells) or "; write it as 'time [s],voltage [kV]'"
        known = [cell for cell in cells if cell in CHANNELS]
        hint = f"; write '{known[0]} [{CHANNELS[known[0]]}]'" if known else hint
        raise UserError(f"{path}: no column of the header {header[:60]!r} has a unit{hint}")


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
    """Read a delimited text file into columns of unconverted cells.

    Parameters
    ----------
    record_format : `encoding`, `delimiter`, `header_lines`, `columns`, `decimal`; None for a
        file
        with a ``name [unit]`` header. `header_lines` counts non-empty lines: above the data if
        there are `columns`, else above the header.
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
    """Return columns and delimiter, and leave the stream where the data begin."""
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
    """Return the delimiter that splits the first data line into `width` cells."""
    marks = (*DELIMITERS, r"\s+")
    return next((m for m in marks if lines and len(split(lines[0], m)) == width), ",")


def format_faults(record_format: Mapping[str, Any] | None, where: str) -> list[str]:
    """Faults of the encoding and the delimiter that `record_format` states."""
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
    """Check that the first row matches the header and has a number, and the last is complete."""
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
