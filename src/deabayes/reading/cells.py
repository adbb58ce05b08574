"""The cells of a line: what separates them, and which of them are numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

from deabayes.faults import UserError

DELIMITERS = ("\t", ";", ",")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number whose comma may be a decimal one or separate thousands."""


def split(line: str, delimiter: str) -> list[str]:
    """The cells of one line, unquoted."""
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
    """A UserError for a last header line that is a row of `count` numbers."""
    if len(cells) == count and all(map(is_number, cells)):
        raise UserError(
            f"{path}: the last header line is {', '.join(cells)[:40]!r}, which is data; "
            "correct header_lines under record_format in specimen.yaml"
        )


def sniff_delimiter(header: str) -> str:
    """Tab, semicolon or comma: the one that splits a header into the most ``name [unit]`` cells."""

    def cells(mark: str) -> tuple[int, int]:
        found = split(header, mark)
        return sum("[" in cell for cell in found), len(found)

    return max(DELIMITERS, key=cells)


def sniff_decimal(lines: Sequence[str], delimiter: str, path: Path) -> str:
    """Decimal comma when numbers hold a comma and none holds a point.

    Raises
    ------
    UserError : every comma may separate thousands.
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
