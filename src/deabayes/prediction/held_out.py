"""What the records held out say of the bands: whether they are right as often as they say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

NARROW_COVERAGE = 0.7
"""Share of a record's points in its 90 % band below which the band is too narrow."""
REJECTED = 1e-3
"""p of the probability integral transforms of a record that was fitted, below which its own
residuals reject the model."""
MOST_NAMED = 4
SCORED_DRAWS = "posterior_draws"
"""Column of errors.csv: of which draws the scores are."""
UNCHECKED = "so nothing tells here whether bands on records that were not fitted are wide enough"


def missed(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of errors.csv of held-out records that the 90 % predictive band misses."""
    held_out = errors[errors["role"] == "validate"]
    return held_out[held_out["coverage_90"] < NARROW_COVERAGE]


def rejected(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of errors.csv of fitted records whose residuals, or bands, reject the model."""
    fitted = errors[errors["role"] == "calibrate"]
    return fitted[(fitted["coverage_90"] < NARROW_COVERAGE) | (fitted["pit_p"] < REJECTED)]


def note_beside(posterior: Path, draws: str, none_held_out: bool) -> str:
    """What the errors.csv beside a posterior.nc says of its bands; nothing if they hold.

    Parameters
    ----------
    draws : what tells the posterior's draws from others (`sum_of_draws`).
    none_held_out : the study names no record to hold out, so that there is nothing to score.
    """
    table = posterior.with_name("errors.csv")
    errors = _scores(table, draws)
    if errors is not None:
        return _too_narrow(errors)
    if none_held_out:
        return ""
    if table.is_file():
        return (
            f"errors.csv beside the posterior is not of its draws, {UNCHECKED}; score them again "
            "(`deabayes predict` without --excitation), or copy the errors.csv that belongs to it"
        )
    return (
        f"held-out scores (errors.csv) are not beside the posterior, {UNCHECKED}; copy errors.csv "
        "along with it"
    )


def _scores(table: Path, draws: str) -> pd.DataFrame | None:
    """An errors.csv, if it is there and of these draws."""
    import pandas as pd

    try:
        errors = pd.read_csv(table)
    except (OSError, ValueError):  # not there, or no table
        return None
    of_these = SCORED_DRAWS in errors and bool((errors[SCORED_DRAWS] == draws).all())
    return errors if of_these else None


def _too_narrow(errors: pd.DataFrame) -> str:
    """How many held-out records the bands miss, and which; nothing if they miss none."""
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
