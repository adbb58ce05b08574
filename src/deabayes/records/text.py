"""Read records from text files, with `name [unit]` headers or described by a format."""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import Report, UserError
from deabayes.records.columns import (
    CHANNELS,
    COMMENT,
    Column,
    Table,
    from_format,
    from_header,
    renamed,
    unit_hint,
)

NAME_AND_UNIT = re.compile(r"\w+ *\[[^\[\]]*\]")
DELIMITER_NAMES = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", "": r"\s+", "space": r"\s+",
                   "comma": ",", "semicolon": ";"}  # fmt: skip
NO_DELIMITERS = ".+-#\"'\n\r"
MISSING = ("", *"nan NaN NAN -nan -NaN NA N/A n/a <NA> None null NULL".split())
"""Cells without a value."""
SNIFFED_LINES = 50
DELIMITERS = ("\t", ";", ",")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number whose comma may be a decimal comma or separate thousands."""
BEGINNINGS = {
    b"PK\x03\x04": ("an Excel workbook or another zip archive", "name a workbook .xlsx, or "),
    b"\xd0\xcf\x11\xe0": ("an old Excel workbook or another Office file", ""),
    b"MATLAB 5.0": ("a MATLAB file", "name it .mat, or "),
    b"\x89HDF": ("an HDF5 file, as MATLAB 7.3 writes", "name that .mat, or "),
    b"TDSm": ("a TDMS file", "name it .tdms, or "),
    b"%PDF": ("a PDF", ""),
    b"\x1f\x8b": ("a compressed file", "unpack it, or "),
}
"""First bytes of a file -> its likely kind, and what to do before exporting it as CSV."""
MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Byte order marks. UTF-32 comes first, because one of its marks begins with a mark of UTF-16."""
LOOKED_AT = 4096
LONGEST_LINE = 8192
COMMENT_AT_START = re.compile(COMMENT.pattern.encode() + rb"|sep=.?$")
"""A comment, or the line that tells Excel the delimiter."""
QUOTED_OR_COMMENT = re.compile(
    rb'("[^"\r\n]*")|' + COMMENT.pattern.encode() + rb"[^\r\n]*", re.MULTILINE
)
UTF_8 = codecs.lookup("utf-8")


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
    settings, report = dict(record_format or {}), Report(str(path))
    check_format(settings, report)
    report.raise_faults()
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


def check_format(record_format: Mapping[str, Any] | None, report: Report) -> None:
    """Report an encoding or a delimiter of `record_format` that does not exist."""
    settings = record_format or {}
    encoding = str(settings.get("encoding", "utf-8"))
    try:
        b"a".decode(encoding, errors="replace")
    except (LookupError, UnicodeError):
        report.fault(
            f"unknown encoding {encoding!r}; give one such as utf-8, latin-1, utf-16 or gbk",
            "record_format.encoding",
        )
    mark = _named_delimiter(settings.get("delimiter"))
    if mark not in (None, r"\s+") and (len(mark) > 1 or mark.isalnum() or mark in NO_DELIMITERS):
        report.fault(
            f"{settings['delimiter']!r} separates no columns; give one character such as ',' or "
            "';', or tab or whitespace",
            "record_format.delimiter",
        )


def _named_delimiter(name: str | None) -> str | None:
    return None if name is None else DELIMITER_NAMES.get(name.strip(" ").lower(), name.strip(" "))


def _check_rows(path: Path, width: int, delimiter: str, first: str, last: str) -> None:
    """Check that the first row matches the header and has a number, and the last is complete."""
    cells = split(first, delimiter)
    if cells[width:] not in ([], [""]) or len(cells) < width:
        raise UserError(
            f"{path}: {width} columns are named, but the first data row {first[:60]!r} "
            f"has {len(cells)}; check the delimiter ({_describe(delimiter)}) and the header"
        )
    if len(split(last, delimiter)) < width:
        raise UserError(
            f"{path}: the last row {last[:60]!r} has {len(split(last, delimiter))} of {width} "
            "columns, the file is truncated; copy it again or remove that row"
        )
    if not any(is_number(cell) for cell in cells):
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


def open_text(path: Path, settings: Mapping[str, Any]) -> io.BytesIO:
    r"""Return the file as UTF-8 with ``\n`` line ends.

    A byte order mark has priority over the encoding in `settings`.

    Raises
    ------
    UserError : an empty or a binary file, or not the stated encoding.
    """
    content = path.read_bytes()
    if not content:
        raise UserError(f"{path}: the file is empty; copy the record again")
    for start, (kind, remedy) in BEGINNINGS.items():
        if content.startswith(start):
            raise UserError(
                f"{path}: is not a text file but looks like {kind}; {remedy}export it as CSV"
            )
    marked = next((name for mark, name in MARKS.items() if content.startswith(mark)), None)
    encoding = marked or str(settings.get("encoding", "utf-8"))
    if codecs.lookup(encoding) != UTF_8:
        if b"\0" in "a".encode(encoding) and b"\0" not in content[:LOOKED_AT]:
            raise UserError(
                f"{path}: is not {encoding}, which specimen.yaml states (record_format.encoding); "
                "save the file so, or remove that key: UTF-8, and UTF-16 with a byte order mark, "
                "are read without it"
            )
        content = content.decode(encoding, errors="replace").encode()
    _refuse_null_bytes(content[:LOOKED_AT], path)
    return io.BytesIO(content.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))


def _refuse_null_bytes(start: bytes, path: Path) -> None:
    """Raise a UserError if the decoded text contains null bytes."""
    first, second = (start[i::2].count(b"\0") > 0.4 * len(start) for i in (0, 1))
    if first != second:
        raise UserError(
            f"{path}: is not UTF-8 but looks like UTF-16 without a byte order mark; export it as "
            "UTF-8, or state its encoding in specimen.yaml: "
            f"record_format: {{encoding: utf-16-{'be' if first else 'le'}}}"
        )
    if b"\0" in start:
        raise UserError(
            f"{path}: is not a text file but looks like a binary one (it holds null bytes); "
            "export it as CSV"
        )


def lines(stream: io.BytesIO) -> Iterator[tuple[int, bytes]]:
    """Yield numbered lines that are neither empty nor comments."""
    for number, line in enumerate(iter(stream.readline, b""), start=1):
        bare = line.removeprefix(codecs.BOM_UTF8).strip()
        if bare and not COMMENT_AT_START.match(bare):
            yield number, bare


def peek(stream: io.BytesIO, count: int) -> list[str]:
    """Return the next lines with data, without moving the stream."""
    position = stream.tell()
    data_lines = []
    for _, line in lines(stream):
        data_lines.append(line.decode("utf-8", errors="replace"))
        if len(data_lines) == count:
            break
    stream.seek(position)
    return data_lines


def last_line(stream: io.BytesIO) -> str:
    """Return the last line with data, read from the end of the file; there must be one."""
    position, end = stream.tell(), stream.getbuffer().nbytes
    size = LONGEST_LINE
    data_lines: list[bytes] = []
    while len(data_lines) < 2 and size < 2 * (end - position) + LONGEST_LINE:
        stream.seek(max(position, end - size))  # the first line may be cut there
        data_lines = [line for _, line in lines(stream)]
        size *= 2
    stream.seek(position)
    return data_lines[-1].decode("utf-8", errors="replace")


def skip_lines(stream: io.BytesIO, count: int, path: Path) -> str:
    """Skip `count` non-empty lines of any content, and return the last of them."""
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


def without_comments(stream: io.BytesIO) -> io.BytesIO:
    """Return the rest of the stream without comments; pandas misreads Excel errors as comments."""
    content = stream.read()
    if b"#" in content:
        content = QUOTED_OR_COMMENT.sub(rb"\1", content)
    return io.BytesIO(content)


def split(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, without quotation marks."""
    if delimiter == r"\s+":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def refuse_skipped_data(cells: Sequence[str], count: int, path: Path) -> None:
    """Raise a UserError if the last header line is a row of `count` numbers."""
    if len(cells) == count and all(map(is_number, cells)):
        raise UserError(
            f"{path}: the last header line is {', '.join(cells)[:40]!r}, which is data; "
            "correct header_lines under record_format in specimen.yaml"
        )


def sniff_delimiter(header: str) -> str:
    """Return the tab, semicolon or comma that gives the most ``name [unit]`` cells."""

    def cells(mark: str) -> tuple[int, int]:
        found = split(header, mark)
        return sum("[" in cell for cell in found), len(found)

    return max(DELIMITERS, key=cells)


def sniff_decimal(lines: Sequence[str], delimiter: str, path: Path) -> str:
    """Return a comma if numbers contain commas and no points, else a point.

    Raises
    ------
    UserError : all commas could separate thousands.
    """
    cells = [cell for line in lines for cell in split(line, delimiter) if is_number(cell)]
    commas = [cell for cell in cells if "," in cell]
    if not commas or any("." in cell for cell in cells):
        return "."
    if all(THOUSANDS.fullmatch(cell) for cell in commas):
        one = commas[0]
        raise UserError(
            f"{path}: {one} may be {one.replace(',', '')} or {one.replace(',', '.')}; write "
            "numbers with a decimal point and without separators of thousands, or state "
            "record_format: {decimal: ','} in specimen.yaml"
        )
    return ","
