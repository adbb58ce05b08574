"""Open text files: their encoding, and files that are no text."""

from __future__ import annotations

import codecs
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deabayes.faults import UserError

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
BINARY_AT = 4096
UTF_8 = codecs.lookup("utf-8")


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
        if b"\0" in "a".encode(encoding) and b"\0" not in content[:BINARY_AT]:
            raise UserError(
                f"{path}: is not {encoding}, which specimen.yaml states (record_format.encoding); "
                "save the file so, or remove that key: UTF-8, and UTF-16 with a byte order mark, "
                "are read without it"
            )
        content = content.decode(encoding, errors="replace").encode()
    _refuse_null_bytes(content[:BINARY_AT], path)
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
