"""The cells of a line: what separates them, and which of them are numbers."""

from __future__ import annotations

import csv
from collections.abc import Sequence

DELIMITERS = ("\t", ";", ",")


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


def sniff_delimiter(header: str) -> str:
    """Tab, semicolon or comma: the one that splits a header into the most ``name [unit]`` cells."""

    def cells(mark: str) -> tuple[int, int]:
        found = split(header, mark)
        return sum("[" in cell for cell in found), len(found)

    return max(DELIMITERS, key=cells)


def sniff_decimal(lines: Sequence[str], delimiter: str) -> str:
    """Decimal comma when numbers hold a comma and none holds a point."""
    cells = [cell for line in lines for cell in split(line, delimiter) if is_number(cell)]
    comma = any("," in cell for cell in cells)
    return "," if comma and not any("." in cell for cell in cells) else "."
