"""Whether a shipped simulated specimen is what its script writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np


def table(path: Path) -> np.ndarray:
    """The numbers of a record."""
    return np.loadtxt(path, delimiter=",", skiprows=1)


def check_regenerated(
    regenerated: Path, shipped: Path, largest: Callable[[Path], Sequence[float]]
) -> None:
    """Check descriptions and records of a specimen that its script has written anew.

    Parameters
    ----------
    largest : from a shipped record to the largest difference of each of its columns.
    """
    for name in ("experiments.csv", "specimen.yaml", "truth.yaml"):
        assert (regenerated / name).read_text() == (shipped / name).read_text()
    records = sorted(path.name for path in (shipped / "records").iterdir())
    assert records == sorted(path.name for path in (regenerated / "records").iterdir())
    for name in records:
        record = shipped / "records" / name
        difference = np.abs(table(regenerated / "records" / name) - table(record))
        # Another machine's last bit may turn one rounding over.
        assert np.mean(np.any(difference > 1e-9, axis=1)) < 0.01
        assert np.all(difference < largest(record))
        assert record.stat().st_size < 250_000
