"""Records in text files: csv with a `name [unit]` header, and odd ones described by a format."""

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
from deabayes.reading.columns import CHANNELS, Column, Table, from_format, from_header, unit_hint
from deabayes.reading.lines import (
    encoding_fault,
    last_line,
    lines,
    open_text,
    peek,
    skip_lines,
    without_comments,
)

DELIMITERS = ("\t", ";", ",")
DELIMITER_NAMES = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", "": r"\s+", "space": r"\s+",
                   "comma": ",", "semicolon": ";"}  # fmt: skip
NO_DELIMITERS = ".+-#\"'\n\r"
MISSING = ("", *"nan NaN NAN -nan -NaN NA N/A n/a <NA> None null NULL".split())
"""Cells without a value."""
ONE_COLUMN = re.compile(r"\w+ *\[[^\[\]]*\]")
SNIFFED_LINES = 50
NO_TEXT = "{path}: is not a text file; give it its right ending or export as csv"


def read_text(path: Path, record_format: Mapping[str, Any] | None = None) -> Table:
    """Read a delimited text file into columns as they are written.

    Parameters
    ----------
    record_format : `encoding`, `delimiter`, `header_lines` (lines that are not
        empty), `columns`, `decimal`; None for a file with a ``name [unit]`` header.

    Raises
    ------
    UserError : empty file, undecodable header, wrong delimiter, ragged or truncated rows.
    """
    settings = dict(record_format or {})
    if faults := format_faults(settings, str(path)):
        raise Faults(faults)
    try:
        return _read(open_text(path, settings), path, settings)
    except csv.Error as error:
        raise UserError(
            f"{path}: is not a table of text ({error}); copy it again or export it as csv"
        ) from None


def _read(stream: io.BytesIO, path: Path, settings: Mapping[str, Any]) -> Table:
    columns, delimiter = _columns(stream, path, settings)
    sample = peek(stream, SNIFFED_LINES)
    if not sample:
        raise UserError(f"{path}: holds no data rows after the header; copy the record again")
    last = last_line(stream)
    decimal = settings.get("decimal") or sniff_decimal([*sample, last], delimiter)
    _check_rows(path, len(columns), delimiter, sample[0], last)
    trailing = split(sample[0], delimiter)[len(columns) :]
    return _read_columns(stream, path, columns, delimiter, decimal, len(trailing))


def _columns(
    stream: io.BytesIO, path: Path, settings: Mapping[str, Any]
) -> tuple[list[Column], str]:
    """Columns and delimiter; the stream is left where the data begin."""
    columns = from_format(settings)
    delimiter = _named_delimiter(settings.get("delimiter"))
    if columns is None:
        header = _header_line(stream, path)
        delimiter = delimiter or sniff_delimiter(header)
        return _header_columns(header, delimiter, path), delimiter
    skipped = skip_lines(stream, int(settings.get("header_lines", 0)), path)
    delimiter = delimiter or _data_delimiter(peek(stream, 1), len(columns))
    _check_skipped(skipped, delimiter, len(columns), path)
    return columns, delimiter


def sniff_delimiter(header: str) -> str:
    """Tab, semicolon or comma: the one that splits a header into the most ``name [unit]`` cells."""

    def cells(mark: str) -> tuple[int, int]:
        found = split(header, mark)
        return sum("[" in cell for cell in found), len(found)

    return max(DELIMITERS, key=cells)


def _data_delimiter(lines: Sequence[str], width: int) -> str:
    """The delimiter that splits the first data line into `width` cells."""
    marks = (*DELIMITERS, r"\s+")
    return next((m for m in marks if lines and len(split(lines[0], m)) == width), ",")


def sniff_decimal(lines: Sequence[str], delimiter: str) -> str:
    """Decimal comma when numbers hold a comma and none holds a point."""
    cells = [cell for line in lines for cell in split(line, delimiter) if _is_number(cell)]
    comma = any("," in cell for cell in cells)
    return "," if comma and not any("." in cell for cell in cells) else "."


def split(line: str, delimiter: str) -> list[str]:
    """The cells of one line, unquoted."""
    if delimiter == r"\s+":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


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


def _header_line(stream: io.BytesIO, path: Path) -> str:
    for number, line in lines(stream):
        if line.startswith(b"PK\x03\x04"):
            raise UserError(NO_TEXT.format(path=path))
        if line.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise UserError(
                f"{path}: is UTF-16; save the file as UTF-8, or state it in specimen.yaml: "
                "record_format: {encoding: utf-16}"
            )
        try:
            text = line.decode("utf-8")
        except UnicodeDecodeError as error:
            raise UserError(
                f"{path}, line {number}: the header is not UTF-8 (byte 0x{line[error.start]:02x}); "
                "save the file as UTF-8, or give its encoding in specimen.yaml, such as "
                "record_format: {encoding: latin-1}"
            ) from None
        if "\x00" in text:
            raise UserError(NO_TEXT.format(path=path))
        return text
    raise UserError(f"{path}: holds nothing but empty lines and comments; copy the record again")


def _header_columns(header: str, delimiter: str, path: Path) -> list[Column]:
    cells = split(header, delimiter)
    if all(_is_number(cell) for cell in cells):
        raise UserError(
            f"{path}: starts with numbers ({header[:40]!r}) where a header such as "
            "'time [s],voltage [kV]' is needed; add it, or describe the columns under "
            "record_format in specimen.yaml"
        )
    columns = from_header(cells)
    if len(columns) == 1 and not ONE_COLUMN.fullmatch(header.strip()):
        raise UserError(
            f"{path}: only one column found in the header {header[:60]!r}; "
            "separate columns with a comma, ';' or a tab"
        )
    if all(column.unit is None for column in columns):
        hint = unit_hint(cells) or "; write it as 'time [s],voltage [kV]'"
        known = [cell for cell in cells if cell in CHANNELS]
        hint = f"; write '{known[0]} [{CHANNELS[known[0]]}]'" if known else hint
        raise UserError(f"{path}: no column of the header {header[:60]!r} has a unit{hint}")
    if columns[-1].name is None:
        columns.pop()  # a delimiter at the end of the header
    return columns


def _check_skipped(line: str, delimiter: str, count: int, path: Path) -> None:
    cells = split(line, delimiter)
    if len(cells) == count and all(_is_number(cell) for cell in cells):
        raise UserError(
            f"{path}: the last header line is {line[:40]!r}, which is data; "
            "correct header_lines under record_format in specimen.yaml"
        )


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


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
    if not any(_is_number(cell) for cell in found):
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
    return Table(columns, [frame[index].to_numpy() for index in range(len(columns))])


def _describe(delimiter: str) -> str:
    return {"\t": "tab", r"\s+": "white space"}.get(delimiter, delimiter)
