"""Golden reference tables: where they are and how a test reads one."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


def golden_folder() -> Path | None:
    """First existing folder of: DEABAYES_GOLDEN, DEABAYES_DATA/golden, ../shared/data/golden."""
    named = [
        os.environ.get("DEABAYES_GOLDEN"),
        os.environ.get("DEABAYES_DATA") and Path(os.environ["DEABAYES_DATA"]) / "golden",
        REPOSITORY.parent / "shared" / "data" / "golden",
    ]
    return next((Path(folder) for folder in named if folder and Path(folder).is_dir()), None)


@cache
def _parsed(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def load_golden(case: str) -> dict[str, Any]:
    """The whole file of one case (`inputs`, `checks`, `tables`); skips the test when missing."""
    folder = golden_folder()
    if folder is None:
        pytest.skip("no golden tables: set DEABAYES_GOLDEN to the folder that holds them")
    path = folder / f"{case}.json"
    if not path.is_file():
        pytest.skip(f"golden table {case}.json is missing in {folder}")
    return _parsed(path)


def golden_table(case: str, table: str) -> dict[str, np.ndarray]:
    """Columns of one table as arrays (SI as in the file); `null` becomes NaN."""
    columns = load_golden(case)["tables"][table]
    return {name: np.array(column["values"], dtype=float) for name, column in columns.items()}
