"""Records in text files: csv with a `name [unit]` header, and odd ones described by a format."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from deabayes.faults import UserError
from deabayes.reading.columns import CHANNELS, Column, Table, from_format, from_header, unit_hint

DELIMITERS = ("\t", ";", ",")
DELIMITER_NAMES = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", " ": r"\s+"}
SNIFFED_LINES = 50
LONGEST_LINE = 8192


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
    with _open(path, settings) as stream:
        columns, delimiter = _columns(stream, path, settings)
        sample = _peek(stream, SNIFFED_LINES)
        if not sample:
            raise UserError(f"{path}: holds no data rows after the header; copy the record again")
        last = _last_line(stream)
        decimal = settings.get("decimal") or sniff_decimal([*sample, last], delimiter)
        _check_rows(path, len(columns), delimiter, sample[0], last)
        trailing = split(sample[0], delimiter)[len(columns) :]
        return _read_columns(stream, path, columns, delimiter, decimal, len(trailing))


def _columns(stream: BinaryIO, path: Path, settings: Mapping[str, Any]) -> tuple[list[Column], str]:
    """Columns and delimiter; the stream is left where the data begin."""
    columns = from_format(settings)
    delimiter = _named_delimiter(settings.get("delimiter"))
    if columns is None:
        header = _header_line(stream, path)
        delimiter = delimiter or sniff_delimiter(header)
        return _header_columns(header, delimiter, path), delimiter
    skipped = _skip_lines(stream, int(settings.get("header_lines", 0)), path)
    delimiter = delimiter or _data_delimiter(_peek(stream, 1), len(columns))
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


def _named_delimiter(name: str | None) -> str | None:
    return None if name is None else DELIMITER_NAMES.get(name, name)


def _open(path: Path, settings: Mapping[str, Any]) -> BinaryIO:
    """The file as bytes; files in two-byte encodings are turned into UTF-8 first."""
    if path.stat().st_size == 0:
        raise UserError(f"{path}: the file is empty; copy the record again")
    encoding = str(settings.get("encoding", "utf-8"))
    if not encoding.lower().startswith(("utf-16", "utf-32", "utf_16", "utf_32")):
        return path.open("rb")
    return io.BytesIO(path.read_text(encoding, errors="replace").encode())


def _lines(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Numbered lines that are neither empty nor comments."""
    for number, line in enumerate(iter(stream.readline, b""), start=1):
        bare = line.removeprefix(b"\xef\xbb\xbf").strip()
        if bare and not bare.startswith(b"#"):
            yield number, bare


def _header_line(stream: BinaryIO, path: Path) -> str:
    for number, line in _lines(stream):
        try:
            text = line.decode("utf-8")
        except UnicodeDecodeError as error:
            raise UserError(
                f"{path}, line {number}: the header is not UTF-8 (byte 0x{line[error.start]:02x}); "
                "save the file as UTF-8, or describe it under record_format in specimen.yaml"
            ) from None
        if "\x00" in text or line.startswith(b"PK\x03\x04"):
            raise UserError(
                f"{path}: is not a text file; give it its right ending or export as csv"
            )
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
    if len(columns) == 1:
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


def _skip_lines(stream: BinaryIO, count: int, path: Path) -> str:
    """Skip `count` lines that are not empty, whatever their encoding; the last one skipped."""
    last = b""
    skipped = 0
    while skipped < count:
        line = stream.readline()
        if not line:
            raise UserError(
                f"{path}: ends after {skipped} lines, all of them header (header_lines: {count}); "
                "copy the record again"
            )
        if line.strip():
            last, skipped = line.strip(), skipped + 1
    return last.decode("utf-8", errors="replace")


def _check_skipped(line: str, delimiter: str, count: int, path: Path) -> None:
    cells = split(line, delimiter)
    if len(cells) == count and all(_is_number(cell) for cell in cells):
        raise UserError(
            f"{path}: the last header line is {line[:40]!r}, which is data; "
            "correct header_lines under record_format in specimen.yaml"
        )


def _peek(stream: BinaryIO, count: int) -> list[str]:
    """The next lines with data, without moving on."""
    position = stream.tell()
    lines = []
    for _, line in _lines(stream):
        lines.append(line.decode("utf-8", errors="replace"))
        if len(lines) == count:
            break
    stream.seek(position)
    return lines


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _last_line(stream: BinaryIO) -> str:
    """The last line with data, from the end of the file."""
    position = stream.tell()
    end = stream.seek(0, io.SEEK_END)
    stream.seek(max(position, end - LONGEST_LINE))
    lines = [line for line in stream.read().splitlines() if line.strip() and line[:1] != b"#"]
    stream.seek(position)
    return lines[-1].decode("utf-8", errors="replace")


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
    stream: BinaryIO,
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
                stream, sep=delimiter, decimal=decimal, header=None, index_col=False, comment="#",
                names=list(range(len(columns) + trailing)), skipinitialspace=True,
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
