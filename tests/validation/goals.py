"""Goals of the statistical design, and the figures measured so far.

The eight goals were set before the project began. A goal without figures says so, and a goal that
is missed says NO.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from tests.validation import recovery_summary
from tests.validation.rows import Row, write_table

FILE, OVERVIEW = "goals.csv", "goals_overview.csv"
NOT_RUN = "not measured yet"
BY_TESTS = "by make test"
MUST_FAIL = "must fail"
"""Text in a table that marks a noise model that is wrong on purpose."""
COVERED, BAND, BAND_HALF = (0.86, 0.94), (0.85, 0.95), (0.42, 0.58)
DILUTED, LARGEST_CHANGE, WIDEST = 0.75, 0.03, 1.25
MEANS, ENDS = 0.1, 0.15
NATS, CLOSED, OPEN, SURPLUS = 0.5, 0.95, 0.80, 0.02
SHIFT, RATIO = 0.1, 0.05
WIDE, HALF = "90 % band covers ", "50 % band covers "

Figure = tuple[str, str, str]
"""Name of a figure, its value, and whether the goal is met: yes, NO or empty."""
Checked = tuple[str, "pd.Series[Any] | None", bool]
"""A recovery check, its row of figures, and whether its noise model is wrong on purpose."""


def write(folder: Path) -> list[str]:
    """Write goals.csv, a row for every figure, and goals_overview.csv, a row for every goal."""
    table: list[Row] = [
        {"goal": goal, "asked": asked, "of": what, "measured": measured, "met": met}
        for goal, asked, figures in GOALS
        for what, measured, met in figures(folder)
    ]
    write_table(folder / FILE, table)
    overview(pd.DataFrame(table)).to_csv(folder / OVERVIEW, index=False)
    return []


def overview(table: pd.DataFrame) -> pd.DataFrame:
    """One row per goal: how many of its figures are as asked.

    Parameters
    ----------
    table : goals.csv
    """
    return pd.DataFrame([_summed(goal, rows) for goal, rows in table.groupby("goal", sort=False)])


def _summed(goal: object, rows: pd.DataFrame) -> dict[str, object]:
    return {
        "goal": goal,
        "asked": "; ".join(rows["asked"].unique()),
        "figures": len(rows),
        "as asked": int(rows["met"].isin(["yes", BY_TESTS]).sum()),
        "missed": int((rows["met"] == "NO").sum()),
        "not measured": int((rows["measured"] == NOT_RUN).sum()),
    }


def _table(path: Path) -> pd.DataFrame | None:
    return pd.read_csv(path) if path.is_file() else None


def _within(value: float, limits: tuple[float, float]) -> str:
    return "yes" if limits[0] <= value <= limits[1] else "NO"


def _first(text: object) -> float:
    """The number in front of a range: 0.907 of `0.907 (0.86 to 0.96)`."""
    return float(str(text).split()[0])


def by_tests(*names: str) -> Callable[[Path], Iterator[Figure]]:
    """A goal that the test suite holds at every change."""

    def find(folder: Path) -> Iterator[Figure]:
        for name in names:
            yield name, "asserted at every change", BY_TESTS

    return find


def calibrated(folder: Path) -> Iterator[Figure]:
    table = _table(folder / "calibration.csv")
    if table is None:
        yield "", NOT_RUN, ""
        return
    for model, rows in table.groupby("model"):
        outside = int((rows["ranks in 95 % band"] != "yes").sum())
        control = rows[next(name for name in rows if name.startswith("control"))]
        seen = bool(control.str.startswith("leaves").all())
        measured = f"{outside} of {len(rows)} parameters outside, {rows['replicates'].min()} sets"
        measured += "; the narrow control leaves" if seen else "; the control stays inside"
        yield str(model), measured, "yes" if outside == 0 and seen else "NO"


def covered(folder: Path) -> Iterator[Figure]:
    for what, row, wrong in (*_membranes(folder), *_others(folder)):
        if row is None:
            yield what, NOT_RUN, ""
            continue
        share = _first(row["coverage of 90 % intervals"])
        met = ("yes" if share < DILUTED else "NO") if wrong else _within(share, COVERED)
        yield what, f"{share:.3f}, {row['replicates']} specimens", met


def robust(folder: Path) -> Iterator[Figure]:
    """Coverage does not depend on the density of points, nor widths on noise that is absent."""
    checks = {what: row for what, row, _ in _membranes(folder)}
    for what, variant, column, is_met in (
        (
            "coverage when sampled five times faster",
            "dense",
            recovery_summary.CHANGE,
            lambda change: abs(change) < LARGEST_CHANGE,
        ),
        (
            "widths on independent noise, over the right model's",
            "iid",
            recovery_summary.WIDTHS,
            lambda ratio: ratio <= WIDEST,
        ),
    ):
        row = checks[f"membrane, kv_gm_1: {recovery_summary.MEANING[variant]}"]
        value = None if row is None else row[column]
        figure = NOT_RUN, ""
        if row is not None and not pd.isna(value):
            shown = value if isinstance(value, str) else f"{value:.2f}"
            met = "yes" if is_met(_first(value)) else "NO"
            figure = f"{shown}, {row['replicates']} specimens", met
        yield f"membrane, kv_gm_1: {what}", *figure


def _membranes(folder: Path) -> Iterator[Checked]:
    table = _table(folder / "membrane_recovery.csv")
    for model in recovery_summary.MEMBRANES:
        correlated_too = (model.variant, model.order) in recovery_summary.CORRELATED_TOO
        for ending in ("", recovery_summary.WHERE_CORRELATED)[: 1 + correlated_too]:
            meaning, row = recovery_summary.MEANING[model.variant] + ending, None
            if table is not None:
                same = (table["data and fit"] == meaning) & (table["units"] == model.order)
                row = table[same].iloc[0] if same.any() else None
            yield f"membrane, kv_gm_{model.order}: {meaning}", row, MUST_FAIL in meaning


def _others(folder: Path) -> Iterator[Checked]:
    for name, (title, _) in recovery_summary.OTHERS.items():
        table = _table(folder / f"{name}.csv")
        yield title, None if table is None else table.iloc[0], False


def agreeing(folder: Path) -> Iterator[Figure]:
    table = _table(folder / "two_seeds.csv")
    if table is None:
        yield "", NOT_RUN, ""
        return
    for model, rows in table[table["both_converged"] == 1].groupby("model"):
        mean, end = rows["mean_difference_sd"].max(), rows["end_difference_sd"].max()
        measured = f"means {mean:.3f} sd, ends {end:.3f} sd, {len(rows)} specimens"
        yield str(model), measured, "yes" if mean <= MEANS and end <= ENDS else "NO"


def compared(folder: Path) -> Iterator[Figure]:
    table = _table(folder / "nested_evidence.csv")
    if table is None:
        yield "bridge against nested", NOT_RUN, ""
    else:
        most = float(table["difference"].abs().max())
        yield "bridge against nested", f"{most:.2f} nat", "yes" if most <= NATS else "NO"
    table = _table(folder / "order_selection.csv")
    if table is None:
        yield "true order", NOT_RUN, ""
        return
    for _, row in table[table["last unit is shown"] > 0].iterrows():
        with_error = "discrepancy" in row["world"]
        wrong, silent = int(row["wrong"]), int(row["wrong without caution"])
        right, shown = float(row["share right"]), row["last unit is shown"]
        met = right >= (OPEN if with_error else CLOSED) and not (with_error and silent)
        of = f"order, {row['family']}, {row['world']}, {row['true units']} true units"
        measured = f"{right:.2f} right, {wrong} wrong of {shown} shown, {silent} without caution"
        yield of, measured, "yes" if met else "NO"
    surplus, specimens = int(table["surplus unit"].sum()), int(table["specimens"].sum())
    met = "yes" if surplus <= SURPLUS * specimens else "NO"
    yield "a surplus unit", f"{surplus} of {specimens} specimens", met


def held_out(folder: Path) -> Iterator[Figure]:
    for what, row, wrong in (*_membranes(folder), *_others(folder)):
        if row is None:
            yield what, NOT_RUN, ""
            continue
        for column in [name for name in row.index if name.startswith(WIDE) and not wrong]:
            record = column.removeprefix(WIDE)
            wide, half = float(row[column]), float(row[HALF + record])
            both = _within(wide, BAND), _within(half, BAND_HALF)
            yield f"{what}: {record}", f"{wide:.3f}, {half:.3f}", "NO" if "NO" in both else "yes"


def reproduced(folder: Path) -> Iterator[Figure]:
    table = _table(folder / "nist_summary.csv")
    if table is None:
        yield "", NOT_RUN, ""
        return
    done = table[table["converged"] == "yes"]
    exact = (done["mean - exact [sd]"].abs() <= SHIFT) & ((done["sd / exact"] - 1).abs() <= RATIO)
    wrong = ", ".join(done.loc[~exact, "set"])
    short = ", ".join(table.loc[table["converged"] != "yes", "set"])
    good = f"{int(exact.sum())} of {len(table)} sets within {SHIFT} sd and {RATIO:.0%} of exact"
    yield "converged sets", good, "yes" if not wrong and len(done) == len(table) else "NO"
    if wrong:
        yield "converged and off", wrong, "NO"
    if short:
        yield "not converged, and said so", short, "NO"


GOALS: tuple[tuple[str, str, Callable[[Path], Iterator[Figure]]], ...] = (
    ("1 likelihood", "1e-8 of dense covariances, celerite2", by_tests("tests/noise/test_noise.py")),
    (
        "2 conjugate posterior",
        "means in 4 MCSE, sds in 3 %",
        by_tests("tests/statistical/test_engine.py"),
    ),
    ("3 calibration", "ranks in their 95 % band, control outside", calibrated),
    ("4 coverage", "0.86 to 0.94; fitted as independent below 0.75", covered),
    ("4 coverage", "five times faster: changes by less than 0.03; widths within 1.25", robust),
    ("5 two seeds", "means in 0.1 sd, ends of intervals in 0.15 sd", agreeing),
    (
        "6 comparison",
        "0.5 nat; 0.95 right; with an error 0.80, none wrong without a caution; surplus units 2 %",
        compared,
    ),
    ("7 held-out records", "90 % bands 0.85 to 0.95, 50 % bands 0.42 to 0.58", held_out),
    ("8 NIST's regression sets", "certified (or exact) means and sds", reproduced),
)
