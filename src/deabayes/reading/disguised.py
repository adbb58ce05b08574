"""Files that are called text and are something else."""

from __future__ import annotations

import codecs
from pathlib import Path

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
"""How a file begins -> what it looks like, and what to do before it is exported as CSV."""
MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Byte order marks; those of UTF-32 first, as one of them begins with one of UTF-16."""
LOOKED_AT = 4096


def marked_encoding(content: bytes) -> str | None:
    """The encoding that a byte order mark tells, None without one."""
    return next((name for mark, name in MARKS.items() if content.startswith(mark)), None)


def refuse_binary(content: bytes, path: Path) -> None:
    """A UserError for a file that begins as one of another kind does."""
    for start, (kind, remedy) in BEGINNINGS.items():
        if content.startswith(start):
            raise UserError(
                f"{path}: is not a text file but looks like {kind}; {remedy}export it as CSV"
            )


def refuse_encoding(content: bytes, encoding: str, path: Path) -> None:
    """A UserError for a text that is not in the wide encoding stated for it."""
    if b"\0" in "a".encode(encoding) and b"\0" not in content[:LOOKED_AT]:
        raise UserError(
            f"{path}: is not {encoding}, which specimen.yaml states (record_format.encoding); save "
            "the file so, or remove that key: UTF-8, and UTF-16 with a byte order mark, are read "
            "without it"
        )


def refuse_null_bytes(text: bytes, path: Path) -> None:
    """A UserError for bytes that no text has, once it is decoded."""
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
