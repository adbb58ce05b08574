"""The header of a text record: one line of `name [unit]` cells."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Sequence
from pathlib import Path

from deabayes.faults import UserError
from deabayes.reading.cells import DELIMITERS, is_number, sniff_delimiter, split
from deabayes.reading.columns import CHANNELS, Column, from_header, renamed, unit_hint
from deabayes.reading.lines import lines, skip_lines

NAME_AND_UNIT = re.compile(r"\w+ *\[[^\[\]]*\]")


def read_header(
    stream: io.BytesIO,
    path: Path,
    header_lines: int,
    delimiter: str | None,
    named: Sequence[Column] | None,
) -> tuple[list[Column], str]:
    """Columns and delimiter; the stream is left where the data begin.

    Parameters
    ----------
    header_lines : lines above the header, empty ones not counted.
    delimiter : None to find it out.
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
        columns.pop()  # a delimiter at the end of the header
    return columns, delimiter


def _remedy(stream: io.BytesIO, above: str) -> str:
    """What to do where the line just read is none of a header; `above` are header_lines' last."""
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
    """The line above the one just read, empty ones not counted."""
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
