"""Write a simulated specimen as a study folder."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.files import write_text_atomically


def run(write: Callable[[Path], None]) -> None:
    """Write the study folder that the command line names."""
    if len(sys.argv) != 2:
        sys.exit(f"usage: python {sys.argv[0]} FOLDER")
    write(Path(sys.argv[1]))


def quantity(value: float, unit: str, source: str, sd: float | None = None) -> dict[str, object]:
    """Quantity of specimen.yaml; a quantity without `sd` is taken as exact."""
    uncertain = {} if sd is None else {"sd": sd}
    return {"value": value, "unit": unit, **uncertain, "source": source}


def write_descriptions(
    folder: Path,
    rows: Sequence[Mapping[str, object]],
    specimen: Mapping[str, object],
    truth: Mapping[str, object],
    module: str,
) -> None:
    """Write experiments.csv, specimen.yaml and truth.yaml; `module` names the script."""
    write_table(folder / "experiments.csv", rows)
    comment = f"Written by `python -m data.make.{module}`; edit that module, not this file."
    write_yaml(folder / "specimen.yaml", specimen, comment)
    write_yaml(folder / "truth.yaml", truth, comment)


def numbered(**values: Sequence[float]) -> dict[str, float]:
    """Parameters `{name}_1`, `{name}_2`, ... of lists of values."""
    return {f"{n}_{i}": v for n, several in values.items() for i, v in enumerate(several, start=1)}


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
