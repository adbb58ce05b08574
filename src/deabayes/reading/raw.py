"""A study folder as it was read: rows of experiments.csv and raw records in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from deabayes.experiment import FloatArray, Role


@dataclass(frozen=True)
class ExperimentRow:
    """One row of experiments.csv; further columns are `metadata`."""

    name: str
    protocol: str
    record: str
    role: Role
    excitation: str
    response: str
    metadata: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class RawRecord:
    """One record as it is in its file, columns converted to SI, nothing else changed.

    `left_out` rows are missing where the specimen asks for that (`incomplete_rows`).
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    sha256: str
    left_out: int = 0
