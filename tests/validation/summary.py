"""Write tables and figures of docs/validation from the rows that the checks stored.

    python -m tests.validation.summary

Files that no check has written yet are named. Their pages say "not measured yet".
"""

from __future__ import annotations

from pathlib import Path

from tests.validation import calibration, goals, nested, nist_summary, recovery_summary, tally
from tests.validation.rows import OUTPUT

NESTED = (nested.EVIDENCE, nested.PARAMETERS)


def write(folder: Path = OUTPUT) -> list[str]:
    """Write all tables and figures; return the names of the missing files."""
    parts = (calibration, recovery_summary, tally, nist_summary, goals)
    missing = [name for part in parts for name in part.write(folder)]
    return missing + [name for name in NESTED if not (folder / name).exists()]


if __name__ == "__main__":
    for name in write():
        print(f"not measured yet: {OUTPUT / name}")
