"""Read records from text files, with a header of names and units or described by a format."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from deabayes.faults import Report, UserError
from deabayes.records.columns import (
    COMMENT,
    Column,
    Table,
    from_format,
    from_header,
    renamed,
)
from deabayes.records.layout import (
    LOOKED_AT,
    MISSING,
    Layout,
    find_layout,
    is_like,
    is_number,
    numeric_columns,
    units_in,
)
from deabayes.records.opening import open_text

NAME_AND_UNIT = re.compile(r"\w+ *\[[^\[\]]*\]")
DELIMITER_NAMES = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", "": r"\s+", "space": r"\s+",
                   "comma": ",", "semicolon": ";"}  # fmt: skip
NO_DELIMITERS = ".+-#\"'\n\r"
SNIFFED_LINES = 50
DELIMITERS = ("\t", ";", ",")
ANY_DELIMITER = (*DELIMITERS, r"\s+")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number whose comma may be a decimal comma or separate thousands."""
LONGEST_LINE = 8192
COMMENT_AT_START = re.compile(COMMENT.pattern.encode() + rb"|sep=.?$")
"""A comment, or the line that tells Excel the delimiter."""
QUOTED_OR_COMMENT = re.compile(
    rb'("[^"\r\n]*")|' + COMMENT.pattern.encode() + rb"[^\r\n]*", re.MULTILINE
)


def read_text(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    named: Sequence[Column] | None = None,
) -> Table:
    """Read a delimited text file into columns of unconverted cells.

    Parameters
    ----------
    record_format : `encoding`, `delimiter`, `header_lines`, `columns`, `decimal`; None for a
        file with a header of names and units. `header_lines` counts non-empty lines: above the
        data if there are `columns`, else above the header.
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
    columns, delimiter, notes = _columns(stream, path, settings, named)
    sample = peek(stream, SNIFFED_LINES)
    if not sample:
        raise UserError(f"{path}: holds no data rows after the header; copy the record again")
    last = last_line(stream)
    decimal = settings.get("decimal") or sniff_decimal([*sample, last], delimiter, path)
    _check_rows(path, len(columns), delimiter, sample, last, _header_lines(settings))
    trailing = split(sample[0], delimiter)[len(columns) :]
    table = read_columns(stream, path, columns, delimiter, decimal, len(trailing))
    return replace(table, notes=notes)


def _header_lines(settings: Mapping[str, Any]) -> int:
    return int(settings.get("header_lines", 0))


def _columns(
    stream: io.BytesIO, path: Path, settings: Mapping[str, Any], named: Sequence[Column] | None
) -> tuple[list[Column], str, list[str]]:
    """Return columns, delimiter and notes, and leave the stream where the data begin."""
    columns = from_format(settings)
    delimiter = _named_delimiter(settings.get("delimiter"))
    skipped = skip_lines(stream, _header_lines(settings), path)
    if columns is None:
        return read_header(stream, path, skipped, delimiter, named)
    first = peek(stream, 1)
    delimiter = delimiter or _data_delimiter(first, len(columns))
    rows = [split(line, delimiter) for line in (*skipped, *first)]
    refuse_skipped_data(rows[: len(skipped)], rows[len(skipped) :], path)
    return renamed(columns, named, str(path)), delimiter, []


def _data_delimiter(lines: Sequence[str], width: int) -> str:
    """Return the delimiter that splits the first data line into `width` cells."""
    return next((m for m in ANY_DELIMITER if lines and len(split(lines[0], m)) == width), ",")


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


def _check_rows(
    path: Path, width: int, delimiter: str, sample: Sequence[str], last: str, header_lines: int
) -> None:
    """Check that the first row matches the header and has a number, and the last is complete."""
    first = sample[0]
    cells = split(first, delimiter)
    if any(cells[width:]) or len(cells) < width:
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
        further = (
            n for n, line in enumerate(sample) if any(map(is_number, split(line, delimiter)))
        )
        lines = header_lines + next(further, 1)
        raise UserError(
            f"{path}: the first data row is {first[:60]!r}, which holds no number; correct the "
            f"row, or put this into specimen.yaml: record_format: {{header_lines: {lines}}}"
        )


def read_columns(
    stream: io.BytesIO,
    path: Path,
    columns: Sequence[Column],
    delimiter: str,
    decimal: str,
    trailing: int,
) -> Table:
    """Read the rest of the stream with pandas' C parser.

    Parameters
    ----------
    decimal : decimal sign of the numbers.
    trailing : cells behind the columns that rows may have; they are left out.
    """
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
    skipped: Sequence[str],
    delimiter: str | None,
    named: Sequence[Column] | None,
) -> tuple[list[Column], str, list[str]]:
    """Return columns, delimiter and notes, and leave the stream where the data begin.

    Lines above the header are left out where it is certain which line that is.

    Parameters
    ----------
    skipped : the lines above, of which record_format says that they are no header.
    delimiter : None to detect it.
    named : names and units that experiments.csv gives to columns of the header.
    """
    found, layout = _text_layout(peek(stream, LOOKED_AT), delimiter)
    above = [line for _, line in itertools.islice(lines(stream), layout.header if layout else 0)]
    header, number = _header_line(stream, path)
    width = None if layout else _width_of_numbers(header, stream, delimiter)
    if width is not None:
        raise UserError(
            f"{path}: starts with numbers ({header[:40]!r}) where a header such as "
            f"'time [s],voltage [kV]' is needed; {_remedy(stream, skipped, width)}"
        )
    delimiter = found if layout else delimiter or sniff_delimiter(header)
    cells = split(header, delimiter)
    units, notes = _units_below(stream, delimiter, len(cells)), []
    columns = from_header(cells, units)
    if not any(column.name for column in columns):
        raise UserError(
            f"{path}: the header {header[:60]!r} names no column; {_described(len(columns))}"
        )
    columns = renamed(columns, named, str(path))
    if len(columns) == 1 and not NAME_AND_UNIT.fullmatch(header.strip()):
        raise UserError(
            f"{path}: only one column found in the header {header[:60]!r}; "
            "separate columns with a comma, ';' or a tab"
        )
    if above or units is not None:
        below = "" if units is None else f", with units in line {number + 1}"
        left_out = "; what is above it is left out" if above else ""
        notes = [f"header in line {number}{below}{left_out}"]
    while columns[-1].name is None:
        columns.pop()  # the header ends with a delimiter
    return columns, delimiter, notes


def _text_layout(rows: Sequence[str], delimiter: str | None) -> tuple[str, Layout | None]:
    """Return the delimiter and the layout of lines of text, if there is a certain one."""
    for mark in ANY_DELIMITER if delimiter is None else (delimiter,):
        cells = [split(line, mark) for line in rows]
        if numeric_columns(cells)[0]:
            return mark, find_layout(cells)
    return "", None


def _units_below(stream: io.BytesIO, delimiter: str, width: int) -> list[str] | None:
    """Return the units if the next line holds nothing else, and move behind it."""
    position = stream.tell()
    _, line = next(lines(stream), (0, b""))
    units = units_in(split(line.decode("utf-8", errors="replace"), delimiter), width)
    if units is None:
        stream.seek(position)
    return units


def _remedy(stream: io.BytesIO, skipped: Sequence[str], width: int) -> str:
    """Say what to do if the line just read is no header but `width` numbers."""
    comment = _line_before(stream)
    if comment.startswith("#") and NAME_AND_UNIT.search(comment):
        return f"remove the '#' before {comment.lstrip('# ')[:40]!r}"
    if not skipped:
        return _described(width)
    return (
        f"header_lines: {len(skipped)} under record_format in specimen.yaml counts the lines above "
        f"the header and ends with {skipped[-1][:40]!r}; state fewer, or remove it, as the header "
        "is found without it"
    )


def _described(width: int) -> str:
    """Return the advice to describe the columns, with the lines for it."""
    columns = ", ".join(["{name: ..., unit: ...}"] * width)
    return (
        "add it, or describe the columns under record_format in specimen.yaml, filled in: "
        f"record_format: {{columns: [{columns}]}}"
    )


def _width_of_numbers(line: str, stream: io.BytesIO, delimiter: str | None) -> int | None:
    """Return how many columns a line has that is numbers or like the next line; None for others."""
    below = peek(stream, 1)
    for mark in ANY_DELIMITER if delimiter is None else (delimiter,):
        cells = split(line, mark)
        like = len(cells) > 1 and any(is_like(cells, split(other, mark)) for other in below)
        if like or all(map(is_number, cells)):
            return len(cells)
    return None


def _line_before(stream: io.BytesIO) -> str:
    """Return the non-empty line above the one just read."""
    read = stream.getvalue()[: stream.tell()].removeprefix(codecs.BOM_UTF8)
    filled = [line.strip() for line in read.splitlines() if line.strip()]
    return filled[-2].decode("utf-8", errors="replace") if len(filled) > 1 else ""


def _header_line(stream: io.BytesIO, path: Path) -> tuple[str, int]:
    """Return the next line, which must be UTF-8, and its number in the file."""
    for _, line in lines(stream):
        number = stream.getvalue()[: stream.tell()].rstrip(b"\n").count(b"\n") + 1
        try:
            return line.decode("utf-8"), number
        except UnicodeDecodeError as error:
            raise UserError(
                f"{path}, line {number}: the header is not UTF-8 (byte 0x{line[error.start]:02x}); "
                "save the file as UTF-8, or give its encoding in specimen.yaml, such as "
                "record_format: {encoding: latin-1}"
            ) from None
    raise UserError(f"{path}: holds nothing but empty lines and comments; copy the record again")


def lines(stream: io.BytesIO) -> Iterator[tuple[int, bytes]]:
    """Yield numbered lines that are neither empty nor comments, with empty cells at both ends."""
    for number, line in enumerate(iter(stream.readline, b""), start=1):
        bare = line.removeprefix(codecs.BOM_UTF8).strip(b" \n")
        if bare.strip() and not COMMENT_AT_START.match(bare):
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


def skip_lines(stream: io.BytesIO, count: int, path: Path) -> list[str]:
    """Skip `count` non-empty lines of any content, and return them."""
    skipped: list[str] = []
    while len(skipped) < count:
        line = stream.readline()
        if not line:
            raise UserError(
                f"{path}: ends after {len(skipped)} lines, all of them header (header_lines: "
                f"{count}); copy the record again"
            )
        if line.strip():
            skipped.append(line.strip(b" \n").decode("utf-8", errors="replace"))
    return skipped


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


def refuse_skipped_data(
    skipped: Sequence[Sequence[str]], data: Sequence[Sequence[str]], path: Path
) -> None:
    """Raise a UserError if the last lines that are skipped look like the first data row."""
    count = len(skipped)
    for cells in reversed(skipped if data else ()):
        if not (_is_comment(cells) or is_like(cells, data[0])):
            break
        count -= 1
    lost = [cells for cells in skipped[count:] if not _is_comment(cells)]
    if lost:
        raise UserError(
            f"{path}: header_lines: {len(skipped)} under record_format in specimen.yaml leaves out "
            f"{', '.join(lost[0])[:40]!r}, which is data; state header_lines: {count}"
        )


def _is_comment(cells: Sequence[str]) -> bool:
    return bool(cells) and COMMENT.match(cells[0]) is not None


def sniff_delimiter(header: str) -> str:
    """Return the tab, semicolon or comma that gives the most cells with a unit."""

    def cells(mark: str) -> tuple[int, int]:
        found = split(header, mark)
        return sum("[" in cell or "(" in cell for cell in found), len(found)

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
