"""Ways to break the sound study folder, each a function of the folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.shared.study_folders import HEADER, record_lines, replace_in, write_lines

Break = Callable[[Path], object]


def table(old: str, new: str) -> Break:
    """Change experiments.csv."""
    return lambda folder: replace_in(folder / "experiments.csv", old, new)


def specimen(old: str, new: str) -> Break:
    """Change specimen.yaml."""
    return lambda folder: replace_in(folder / "specimen.yaml", old, new)


def row(number: int, text: str) -> Break:
    """Put `text` into data row `number` of records/relax.csv."""

    def change(folder: Path) -> None:
        lines = record_lines(1)
        lines[number] = text
        write_lines(folder / "records" / "relax.csv", lines)

    return change


def column(index: int, value: str) -> Break:
    """Put one value into a whole column of records/relax.csv."""

    def change(folder: Path) -> None:
        rows = [line.split(",") for line in record_lines(1)[1:]]
        lines = [",".join([*cells[:index], value, *cells[index + 1 :]]) for cells in rows]
        write_lines(folder / "records" / "relax.csv", [HEADER, *lines])

    return change


def whole(*lines: str) -> Break:
    """Make records/relax.csv of these lines."""
    return lambda folder: write_lines(folder / "records" / "relax.csv", list(lines))


def header(text: str) -> Break:
    """Change the header of records/relax.csv."""
    return lambda folder: write_lines(
        folder / "records" / "relax.csv", [text, *record_lines(1)[1:]]
    )


def voltage(unit: str, volts: str, column: str, stated: str) -> Break:
    """Give the record a voltage and its row a number about it."""

    def change(folder: Path) -> None:
        first, *rows = record_lines(1)
        lines = [
            f"{first},voltage [{unit}]",
            *(f"{r},{volts if i else 0}" for i, r in enumerate(rows)),
        ]
        write_lines(folder / "records" / "relax.csv", lines)
        replace_in(folder / "experiments.csv", "stretch_rate_per_s", f"stretch_rate_per_s,{column}")
        replace_in(folder / "experiments.csv", "first,", f"first,,{stated}")

    return change


def copy_record(folder: Path) -> None:
    """Validate on the very record that is fitted."""
    source = (folder / "records" / "relax.csv").read_bytes()
    (folder / "records" / "pull.csv").write_bytes(source)


def cut_record(folder: Path) -> None:
    """Cut the record in the middle of a row."""
    path = folder / "records" / "relax.csv"
    path.write_bytes(path.read_bytes()[:-12])


def stated(column: str, cell: str) -> Break:
    """Say something of the pull in a column that models read as a number."""

    def change(folder: Path) -> None:
        replace_in(folder / "experiments.csv", "stretch_rate_per_s", column)
        replace_in(folder / "experiments.csv", "0.25", cell)

    return change
