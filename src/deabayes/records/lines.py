"""Lines and cells of a text file, for any encoding, line end and separator."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import UserError
from deabayes.records.columns import COMMENT

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


def marked_encoding(content: bytes) -> str | None:
    """Return the encoding that a byte order mark states, None without a mark."""
    return next((name for mark, name in MARKS.items() if content.startswith(mark)), None)


def refuse_binary(content: bytes, path: Path) -> None:
    """Raise a UserError if a file begins like a binary format."""
    for start, (kind, remedy) in BEGINNINGS.items():
        if content.startswith(start):
            raise UserError(
                f"{path}: is not a text file but looks like {kind}; {remedy}export it as CSV"
            )


def refuse_encoding(content: bytes, encoding: str, path: Path) -> None:
    """Raise a UserError if a text is not in the wide encoding stated for it."""
    if b"\0" in "a".encode(encoding) and b"\0" not in content[:LOOKED_AT]:
        raise UserError(
            f"{path}: is not {encoding}, which specimen.yaml states (record_format.encoding); save "
            "the file so, or remove that key: UTF-8, and UTF-16 with a byte order mark, are read "
            "without it"
        )


def refuse_null_bytes(text: bytes, path: Path) -> None:
    """Raise a UserError if the decoded text contains null bytes."""
    start = text[:LOOKED_AT]
    first, second = (start[i::2].count(b"\0") > 0.4 * len(start) for i in (0, 1))
    if first != second:
        raise UserError(
            f"{path}: is not UTF-8 but looks like UTF-16 without a byte order mark; export it as "
            "UTF-8, or state its encoding in specimen.yaml: "
            f"record_format: {{encoding: utf-16-{'be' if first else 'le'}}}"
        )
    if b"\0" in start:
        raise UserError(f"{path}: is not a text file but looks like a binary one (it holds null "
                        "bytes); export it as CSV")  # fmt: skip


LONGEST_LINE = 8192
COMMENT_AT_START = re.compile(COMMENT.pattern.encode() + rb"|sep=.?$")
"""A comment, or the line that tells Excel the delimiter."""
QUOTED_OR_COMMENT = re.compile(
    rb'("[^"\r\n]*")|' + COMMENT.pattern.encode() + rb"[^\r\n]*", re.MULTILINE
)
UTF_8 = codecs.lookup("utf-8")


def open_text(path: Path, settings: Mapping[str, Any]) -> io.BytesIO:
    r"""Return the file as UTF-8 with ``\n`` line ends.

    A byte order mark has priority over the encoding in `settings`.
    """
    content = path.read_bytes()
    if not content:
        raise UserError(f"{path}: the file is empty; copy the record again")
    refuse_binary(content, path)
    encoding = marked_encoding(content) or str(settings.get("encoding", "utf-8"))
    if codecs.lookup(encoding) != UTF_8:
        refuse_encoding(content, encoding, path)
        content = content.decode(encoding, errors="replace").encode()
    refuse_null_bytes(content, path)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return io.BytesIO(content)


def encoding_fault(encoding: str) -> str | None:
    """Return what is wrong with the name of an encoding, None if nothing."""
    try:
        b"a".decode(encoding, errors="replace")
    except (LookupError, UnicodeError):
        return f"unknown encoding {encoding!r}; give one such as utf-8, latin-1, utf-16 or gbk"
    return None


def lines(stream: io.BytesIO) -> Iterator[tuple[int, bytes]]:
    """Yield numbered lines that are neither empty nor comments."""
    for number, line in enumerate(iter(stream.readline, b""), start=1):
        bare = line.removeprefix(codecs.BOM_UTF8).strip()
        if bare and not COMMENT_AT_START.match(bare):
            yield number, bare


def peek(stream: io.BytesIO, count: int) -> list[str]:
    """Return the next lines with data, without moving the stream."""
    position = stream.tell()
    found = []
    for _, line in lines(stream):
        found.append(line.decode("utf-8", errors="replace"))
        if len(found) == count:
            break
    stream.seek(position)
    return found


def last_line(stream: io.BytesIO) -> str:
    """Return the last line with data, read from the end of the file; there must be one."""
    position, end = stream.tell(), stream.getbuffer().nbytes
    size = LONGEST_LINE
    found: list[bytes] = []
    while len(found) < 2 and size < 2 * (end - position) + LONGEST_LINE:
        stream.seek(max(position, end - size))  # the first line may be cut there
        found = [line for _, line in lines(stream)]
        size *= 2
    stream.seek(position)
    return found[-1].decode("utf-8", errors="replace")


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


DELIMITERS = ("\t", ";", ",")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number whose comma may be a decimal comma or separate thousands."""


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
