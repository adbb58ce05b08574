"""The lines of a text file, whatever its encoding and line ends."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from deabayes.faults import UserError
from deabayes.reading.columns import COMMENT
from deabayes.reading.disguised import (
    marked_encoding,
    refuse_binary,
    refuse_encoding,
    refuse_null_bytes,
)

LONGEST_LINE = 8192
COMMENT_AT_START = re.compile(COMMENT.pattern.encode() + rb"|sep=.?$")
"""Or the line in which Excel is told the delimiter."""
QUOTED_OR_COMMENT = re.compile(
    rb'("[^"\r\n]*")|' + COMMENT.pattern.encode() + rb"[^\r\n]*", re.MULTILINE
)
UTF_8 = codecs.lookup("utf-8")


def open_text(path: Path, settings: Mapping[str, Any]) -> io.BytesIO:
    r"""The file as UTF-8 with ``\n`` line ends; its byte order mark says more than `settings`."""
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
    """What is wrong with the name of an encoding, None if nothing is."""
    try:
        b"a".decode(encoding, errors="replace")
    except (LookupError, UnicodeError):
        return f"unknown encoding {encoding!r}; give one such as utf-8, latin-1, utf-16 or gbk"
    return None


def lines(stream: io.BytesIO) -> Iterator[tuple[int, bytes]]:
    """Numbered lines that are neither empty nor comments."""
    for number, line in enumerate(iter(stream.readline, b""), start=1):
        bare = line.removeprefix(codecs.BOM_UTF8).strip()
        if bare and not COMMENT_AT_START.match(bare):
            yield number, bare


def peek(stream: io.BytesIO, count: int) -> list[str]:
    """The next lines with data, without moving on."""
    position = stream.tell()
    found = []
    for _, line in lines(stream):
        found.append(line.decode("utf-8", errors="replace"))
        if len(found) == count:
            break
    stream.seek(position)
    return found


def last_line(stream: io.BytesIO) -> str:
    """The last line with data, from the end of the file; there must be one."""
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
    """Skip `count` lines that are not empty, whatever they hold; the last one skipped."""
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
    """The rest of the stream; pandas would take Excel's errors for comments."""
    content = stream.read()
    if b"#" in content:
        content = QUOTED_OR_COMMENT.sub(rb"\1", content)
    return io.BytesIO(content)
