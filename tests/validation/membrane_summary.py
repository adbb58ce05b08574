"""Tables and figures of the membrane's long checks, of whatever has been run."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import pandas as pd

from tests.validation import membrane_recovery, nested, rank_figure
from tests.validation.ecdf import inside
from tests.validation.membrane_recovery import RANKS, VARIANTS
from tests.validation.neighbours import CORRELATED, correlated
from tests.validation.rows import read
from tests.validation.tally import tally

ORDERS = (1, 2, 3)
PLANNED = (*(("ou", order) for order in ORDERS), *((name, 1) for name in VARIANTS if name != "ou"))
"""What `make validate` runs; other variants of two and three units are shown if they exist."""
MEANING = {
    "ou": "OU + white noise, fitted as such",
    "white": "the same data, fitted as independent noise (must fail)",
    "dense": "sampled five times faster",
    "dense_white": "sampled five times faster, fitted as independent noise (must fail)",
    "iid": "independent noise, fitted as OU + white",
    "iid_white": "independent noise, fitted as such",
}
CORRELATED_TOO = (("ou", 1), ("white", 1), ("dense_white", 1))
"""Of which the specimens whose neighbouring points correlate have a row of their own, too."""
WHERE_CORRELATED = f"; where neighbouring points correlate by {CORRELATED:g} or more"
FEWEST_FOR_BAND = 20
WIDTHS = "width over the right model's"
CHANGE = "coverage of 90 % against the usual sampling, same specimens"


def write(folder: Path) -> list[str]:
    """Write every table and figure whose replicates exist; return the names of what is missing."""
    stored = {
        (variant, order): pd.read_csv(path)
        for variant in VARIANTS
        for order in ORDERS
        if (path := membrane_recovery.path_of(order, variant, folder)).exists()
    }
    missing = [
        membrane_recovery.path_of(order, variant, folder).name
        for variant, order in PLANNED
        if (variant, order) not in stored
    ]
    if stored:
        _save(recovery_table(stored), folder / "membrane_recovery.csv")
    checked = {order: table for (variant, order), table in stored.items() if variant == "ou"}
    if checked:
        tables = [parameter_table(order, table) for order, table in checked.items()]
        _save(pd.concat(tables), folder / "membrane_recovery_parameters.csv")
    for order, table in checked.items():
        if len(table) >= FEWEST_FOR_BAND:
            draw_ranks(order, table, folder / f"membrane_recovery_kv_gm_{order}.png")
    orders = sorted(folder.glob("order_selection_*.csv"))
    if orders:
        _save(tally(chain.from_iterable(map(read, orders))), folder / "order_selection.csv")
    else:
        missing.append("order_selection_*.csv")
    others = (nested.EVIDENCE, nested.PARAMETERS)
    return missing + [name for name in others if not (folder / name).exists()]


def _save(table: pd.DataFrame, path: Path) -> None:
    table.to_csv(path, index=False)
    print(f"\n{path.name}\n{table.to_string(index=False)}")


def parameters(table: pd.DataFrame) -> list[str]:
    """The parameters that were compared with the truth."""
    return [name.removeprefix("rank:") for name in table if name.startswith("rank:")]


def material(table: pd.DataFrame) -> list[str]:
    """The parameters but those of the noise, which a wrong noise model cannot recover."""
    return [name for name in parameters(table) if "." not in name]


def recovery_table(stored: dict[tuple[str, int], pd.DataFrame]) -> pd.DataFrame:
    """Rows per variant and order: coverage of the material parameters and held-out records."""
    rows = []
    for (variant, order), table in stored.items():
        compared = {
            WIDTHS: _widths(stored, variant, order),
            CHANGE: _change(stored, variant, order),
        }
        rows.append(recovery_row(MEANING[variant], order, table, compared))
        if (variant, order) in CORRELATED_TOO:
            some = table[correlated(order, table["replicate"])]
            if len(some):
                rows.append(recovery_row(MEANING[variant] + WHERE_CORRELATED, order, some))
    return pd.DataFrame(rows)


def recovery_row(
    meaning: str, order: int, table: pd.DataFrame, compared: dict[str, str] | None = None
) -> dict[str, object]:
    """What a row of the recovery table says of these replicates.

    Parameters
    ----------
    compared : with what was fitted otherwise, by column.
    """
    good = table[table["converged"] == 1]
    row: dict[str, object] = {
        "data and fit": meaning,
        "units": order,
        "replicates": len(table),
        "converged": len(good),
    }
    for level in (90, 50):
        row[f"coverage of {level} % intervals"] = coverage(table, level)
        row[f"{level} %, converged only"] = coverage(good, level)
        for name in ("step_3.5kV", "sine_2kV"):
            row[f"{level} % band covers {name}"] = f"{table[f'held{level}:{name}'].mean():.3f}"
    row |= compared or {WIDTHS: "", CHANGE: ""}
    row["median CPU s"] = f"{table['cpu_seconds'].median():.0f}"
    row["seed"], row["deabayes"] = table["seed"].iloc[0], table["deabayes"].iloc[-1]
    return row


def coverage(table: pd.DataFrame, level: int) -> str:
    """Mean over the material parameters, and the lowest and highest of them."""
    if not len(table):
        return ""
    shares = [table[f"in{level}:{name}"].mean() for name in material(table)]
    return f"{sum(shares) / len(shares):.3f} ({min(shares):.2f} to {max(shares):.2f})"


def _widths(stored: dict[tuple[str, int], pd.DataFrame], variant: str, order: int) -> str:
    """Median ratio of posterior sds on independent noise, default over right noise model.

    Only of the replicates that both fits have.
    """
    if variant != "iid" or ("iid_white", order) not in stored:
        return ""
    one, other = (stored[key, order].set_index("replicate") for key in ("iid", "iid_white"))
    columns = [f"sd:{name}" for name in material(one)]
    ratios = (one[columns] / other[columns]).dropna()
    return f"{ratios.median().median():.2f}" if len(ratios) else ""


def _change(stored: dict[tuple[str, int], pd.DataFrame], variant: str, order: int) -> str:
    """Difference of the coverage of 90 % intervals from the usual sampling, of the same specimens.

    With the standard error of its mean over specimens, whose parameters are not independent.
    """
    if variant != "dense" or ("ou", order) not in stored:
        return ""
    dense, usual = (stored[key, order].set_index("replicate") for key in ("dense", "ou"))
    columns = [f"in90:{name}" for name in material(dense)]
    changes = (dense[columns] - usual[columns]).dropna().mean(axis=1)
    return f"{changes.mean():+.3f} ± {changes.sem():.3f}" if len(changes) > 1 else ""


def parameter_table(order: int, table: pd.DataFrame) -> pd.DataFrame:
    """One row per parameter: ranks, coverage of all and of converged runs, mean bias."""
    good = table[table["converged"] == 1]
    rows = []
    for name in parameters(table):
        bias = table[f"bias:{name}"]
        enough = len(table) >= FEWEST_FOR_BAND
        ranks = inside(table[f"rank:{name}"], RANKS + 1) if enough else None
        rows.append(
            {
                "units": order,
                "parameter": name,
                "replicates": len(table),
                "ranks in 95 % band": {None: "too few", True: "yes", False: "NO"}[ranks],
                "90 % interval covers": f"{table[f'in90:{name}'].mean():.3f}",
                "90 %, converged only": f"{good[f'in90:{name}'].mean():.3f}" if len(good) else "",
                "50 % interval covers": f"{table[f'in50:{name}'].mean():.3f}",
                "mean bias [sd]": f"{bias.mean():+.2f} ± {bias.sem():.2f}",
                "median sd of the logarithm": f"{table[f'sd:{name}'].median():.2g}",
            }
        )
    return pd.DataFrame(rows)


def draw_ranks(order: int, table: pd.DataFrame, path: Path) -> None:
    """ECDF of the ranks of every parameter."""
    ranks = {n: {"posterior ranks": table[f"rank:{n}"].to_numpy()} for n in parameters(table)}
    title = f"membrane kv_gm_{order}: {len(table)} simulated specimens"
    rank_figure.draw(title, ranks, RANKS + 1, path)
