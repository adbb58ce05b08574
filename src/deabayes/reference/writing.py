"""Write a simulated specimen as a study folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray


def write_record(path: Path, columns: Mapping[str, tuple[FloatArray, int]]) -> None:
    """A csv file from ``{"time [s]": (values, decimals)}``."""
    formats = [f"%.{decimals}f" for _, decimals in columns.values()]
    table = np.column_stack([np.round(values, decimals) for values, decimals in columns.values()])
    rows = [",".join(formats) % tuple(row + 0.0) for row in table]  # + 0.0 turns -0.0 into 0.0
    _write(path, "\n".join([",".join(columns), *rows]) + "\n")


def write_table(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """experiments.csv from one mapping per record, all with the same keys."""
    lines = [",".join(rows[0]), *(",".join(str(value) for value in row.values()) for row in rows)]
    _write(path, "\n".join(lines) + "\n")


def write_yaml(path: Path, content: Mapping[str, object], comment: str) -> None:
    """A YAML file under a comment that says what wrote it."""
    import yaml

    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=96)
    _write(path, f"# {comment}\n{text}")


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text, encoding="utf-8", newline="\n")
    temporary.replace(path)
