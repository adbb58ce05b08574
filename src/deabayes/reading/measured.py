"""What a row of experiments.csv stands for: its response, and a gain's phase with it."""

from __future__ import annotations

from dataclasses import replace

from deabayes.experiment import PHASE
from deabayes.reading.raw import ExperimentRow, RawRecord


def measured_rows(row: ExperimentRow, raw: RawRecord) -> list[ExperimentRow]:
    """The rows that a row of experiments.csv stands for, itself first.

    A frequency response's gain brings the phase of the same record with it, called
    `NAME_phase`.
    """
    if (row.protocol, row.response) != ("frequency_response", "gain") or "phase" not in raw.columns:
        return [row]
    return [row, replace(row, name=f"{row.name}{PHASE}", response="phase")]
