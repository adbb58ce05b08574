"""What the records held out say of the bands: whether they are right as often as they say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

NARROW_COVERAGE = 0.7
"""Share of a record's points in its 90 % band below which the band is too narrow."""
MOST_NAMED = 4


def missed(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of errors.csv of held-out records that the 90 % predictive band misses."""
    held_out = errors[errors["role"] == "validate"]
    return held_out[held_out["coverage_90"] < NARROW_COVERAGE]


def note_beside(posterior: Path) -> str:
    """What the errors.csv beside a posterior.nc says of its bands; nothing if they hold.

    One that is older than the posterior is of another fit, and says nothing.
    """
    import pandas as pd

    table = posterior.with_name("errors.csv")
    if not table.is_file() or table.stat().st_mtime < posterior.stat().st_mtime:
        return ""
    errors = pd.read_csv(table)
    rows = missed(errors).sort_values("coverage_90")
    if rows.empty:
        return ""
    count = int((errors["role"] == "validate").sum())
    named = [
        f"{row['experiment']} {100 * row['coverage_90']:.0f} %"
        for _, row in rows.head(MOST_NAMED).iterrows()
    ]
    more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
    return (
        f"of {count} held-out records the 90 % bands of {len(rows)} are too narrow (they hold, of "
        f"{', '.join(named)}{more}); those of a drive of your own may be as much so"
    )
