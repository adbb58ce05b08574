"""Write a simulated specimen as a study folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.files import write_text_atomically


def write_record(path: Path, columns: Mapping[str, tuple[FloatArray, int]]) -> None:
    """A csv file from ``{"time [s]": (values, decimals)}``."""
    formats = [f"%.{decimals}f" for _, decimals in columns.values()]
    table = np.column_stack([np.round(values, decimals) for values, decimals in columns.values()])
    rows = [",".join(formats) % tuple(row + 0.0) for row in table]  # + 0.0 turns -0.0 into 0.0
    write_text_atomically("\n".join([",".join(columns), *rows]) + "\n", path)


def write_table(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """experiments.csv from one mapping per record, all with the same keys."""
    lines = [",".join(rows[0]), *(",".join(str(value) for value in row.values()) for row in rows)]
    write_text_atomically("\n".join(lines) + "\n", path)


def write_yaml(path: Path, content: Mapping[str, object], comment: str) -> None:
    """A YAML file under a comment that says what wrote it."""
    import yaml

    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=96)
    write_text_atomically(f"# {comment}\n{text}", path)
