"""Tables and figures of the recovery of simulated specimens, from the rows stored so far."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray
from tests.validation import rank_figure, rows
from tests.validation.ecdf import inside
from tests.validation.recovery import RANKS, VARIANTS, Model, specimen

MEANING = {
    "ou": "OU + white noise, fitted as such",
    "white": "the same data, fitted as independent noise (must fail)",
    "dense": "sampled five times faster",
    "dense_white": "sampled five times faster, fitted as independent noise (must fail)",
    "iid": "independent noise, fitted as OU + white",
    "iid_white": "independent noise, fitted as such",
}
MEMBRANES = (
    *(Model("membrane", order) for order in (1, 2, 3)),
    *(Model("membrane", 1, variant) for variant in VARIANTS if variant != "ou"),
)
"""Membranes that `make validate` runs; other variants of more units are shown if they exist."""
OTHERS = {
    "tubular_recovery": ("tubular voigt_kelvin_2_inertia_circuit, joint fit", Model("tubular", 2)),
    **{
        f"strip_recovery_{order}": (f"tensile strip kv_gm_{order}", Model("strip", order))
        for order in (1, 2)
    },
    **{
        f"structure_recovery_rest_{order}": (
            f"minimum-energy structure ogden_{order}, forces at rest",
            Model("rest", order),
        )
        for order in (1, 2)
    },
    **{
        f"structure_recovery_motion_{order}": (
            f"minimum-energy structure ogden_1_units_{order}, sines",
            Model("motion", order),
        )
        for order in (1, 2)
    },
}
"""Name of the table -> title and model, for the kinds with one table for each model."""
CORRELATED = 0.2
CORRELATED_TOO = (("ou", 1), ("white", 1), ("dense_white", 1))
"""Variants and orders with a further row on the specimens whose neighbouring points correlate."""
WHERE_CORRELATED = f"; where neighbouring points correlate by {CORRELATED:g} or more"
FEWEST_FOR_BAND = 20
WIDTHS = "width over the right model's"
CHANGE = "coverage of 90 % against the usual sampling, same specimens"
Stored = Mapping[tuple[str, int], pd.DataFrame]
"""Rows of the membranes by variant and order."""


def write(folder: Path) -> list[str]:
    """Write every table and figure whose rows exist; return the names of the missing files."""
    _write_membranes(folder)
    for name, (title, model) in OTHERS.items():
        if not (folder / model.file).exists():
            continue
        table = pd.read_csv(folder / model.file)
        rows.write_table(folder / f"{name}.csv", [recovery_row(table)])
        parameters = parameter_rows(model.order, table)
        rows.write_table(folder / f"{name}_parameters.csv", parameters)
        _draw(title, table, folder / f"{name}.png")
    models = [*MEMBRANES, *(model for _, model in OTHERS.values())]
    return [model.file for model in models if not (folder / model.file).exists()]


def _write_membranes(folder: Path) -> None:
    models = [Model("membrane", order, variant) for variant in VARIANTS for order in (1, 2, 3)]
    stored = {
        (model.variant, model.order): pd.read_csv(folder / model.file)
        for model in models
        if (folder / model.file).exists()
    }
    if stored:
        rows.write_table(folder / "membrane_recovery.csv", membrane_rows(stored))
    usual = {order: table for (variant, order), table in stored.items() if variant == "ou"}
    if usual:
        parameters = [row for order, table in usual.items() for row in parameter_rows(order, table)]
        rows.write_table(folder / "membrane_recovery_parameters.csv", parameters)
    for order, table in usual.items():
        _draw(f"membrane kv_gm_{order}", table, folder / f"membrane_recovery_kv_gm_{order}.png")


def _draw(title: str, table: pd.DataFrame, path: Path) -> None:
    """Draw the ECDF of the ranks of every parameter if there are enough specimens."""
    if len(table) < FEWEST_FOR_BAND:
        return
    ranks = {n: {"posterior ranks": table[f"rank:{n}"].to_numpy()} for n in compared_names(table)}
    rank_figure.draw(f"{title}: {len(table)} simulated specimens", ranks, RANKS + 1, path)


def compared_names(table: pd.DataFrame) -> list[str]:
    """Return the names of the parameters that were compared with the truth."""
    return [name.removeprefix("rank:") for name in table if name.startswith("rank:")]


def material_names(table: pd.DataFrame) -> list[str]:
    """Return the parameters without those of the noise, which a wrong model cannot recover."""
    return [name for name in compared_names(table) if "." not in name]


def membrane_rows(stored: Stored) -> list[rows.Row]:
    """Return a row for every variant and order, and for its correlated specimens."""
    result = []
    for (variant, order), table in stored.items():
        changes = {
            WIDTHS: width_ratio(stored, variant, order),
            CHANGE: change_of_coverage(stored, variant, order),
        }
        selections = {MEANING[variant]: (table, changes)}
        if (variant, order) in CORRELATED_TOO:
            selected = table[correlated(order, table["replicate"])]
            if len(selected):
                unknown = {WIDTHS: "", CHANGE: ""}
                selections[MEANING[variant] + WHERE_CORRELATED] = selected, unknown
        for meaning, (part, changed) in selections.items():
            result.append(recovery_row(part, {"data and fit": meaning, "units": order}, changed))
    return result


def recovery_row(
    table: pd.DataFrame, first: rows.Row | None = None, changes: Mapping[str, str] | None = None
) -> rows.Row:
    """Return the coverage of material parameters and of held-out records, and the run time.

    Parameters
    ----------
    first : first columns of the row.
    changes : comparison with fits of the same specimens by another model or of other records.
    """
    good = table[table["converged"] == 1]
    held_out = [name.removeprefix("held90:") for name in table if name.startswith("held90:")]
    row: rows.Row = {**(first or {}), "replicates": len(table), "converged": len(good)}
    for level in (90, 50):
        row[f"coverage of {level} % intervals"] = coverage(table, level)
        row[f"{level} %, converged only"] = coverage(good, level)
        for name in held_out:
            row[f"{level} % band covers {name}"] = f"{table[f'held{level}:{name}'].mean():.3f}"
    row |= changes or {}
    row["median CPU s"] = f"{table['cpu_seconds'].median():.0f}"
    row["seed"], row["deabayes"] = table["seed"].iloc[0], table["deabayes"].iloc[-1]
    return row


def coverage(table: pd.DataFrame, level: int) -> str:
    """Return the mean coverage of the material parameters, and the lowest and highest."""
    if not len(table):
        return ""
    shares = [table[f"in{level}:{name}"].mean() for name in material_names(table)]
    return f"{sum(shares) / len(shares):.3f} ({min(shares):.2f} to {max(shares):.2f})"


def width_ratio(stored: Stored, variant: str, order: int) -> str:
    """Return the median ratio of posterior sds on independent noise, default over right model.

    Only specimens that both models were fitted to are counted.
    """
    if variant != "iid" or ("iid_white", order) not in stored:
        return ""
    default, right = (stored[key, order].set_index("replicate") for key in ("iid", "iid_white"))
    columns = [f"sd:{name}" for name in material_names(default)]
    ratios = (default[columns] / right[columns]).dropna()
    return f"{ratios.median().median():.2f}" if len(ratios) else ""


def change_of_coverage(stored: Stored, variant: str, order: int) -> str:
    """Return by how much the coverage of 90 % intervals differs if records are denser.

    The same specimens are compared. The standard error is that of the mean over specimens, because
    the parameters of a specimen are not independent.
    """
    if variant != "dense" or ("ou", order) not in stored:
        return ""
    dense, usual = (stored[key, order].set_index("replicate") for key in ("dense", "ou"))
    columns = [f"in90:{name}" for name in material_names(dense)]
    changes = (dense[columns] - usual[columns]).dropna().mean(axis=1)
    return f"{changes.mean():+.3f} ± {changes.sem():.3f}" if len(changes) > 1 else ""


def correlated(order: int, replicates: Iterable[int]) -> list[bool]:
    """Return which specimens' neighbouring points correlate by the true noise, sampled as usual.

    Correlation times are drawn over decades. If they are shorter than the spacing of points, noise
    is practically independent, and a fit with independent noise loses nothing. The truth alone
    tells these specimens apart, so the coverage of the right model does not change.
    """
    model = Model("membrane", order)
    world = model.world()
    target, times = world.target(order), world.records[0].coordinate
    truths = (specimen(model, world, target, int(index))[0].truth for index in replicates)
    return [lag_one(truth, times) >= CORRELATED for truth in truths]


def lag_one(truth: Mapping[str, FloatArray], times: FloatArray) -> float:
    """Return the mean correlation of neighbouring residuals.

    For Ornstein-Uhlenbeck and white noise and points a time d apart, the correlation is
    sigma_ou^2 exp(-d / tau_ou) / (sigma_ou^2 + sigma_white^2).
    """
    correlated, white, time = (
        float(truth[f"step.{name}"][0]) for name in ("sigma_ou", "sigma_white", "tau_ou")
    )
    share = correlated**2 / (correlated**2 + white**2)
    return float(share * np.exp(-np.diff(times) / time).mean())


def parameter_rows(order: int, table: pd.DataFrame) -> list[rows.Row]:
    """Return a row for every parameter: ranks, coverage of all and of converged runs, mean bias."""
    good, enough = table[table["converged"] == 1], len(table) >= FEWEST_FOR_BAND
    result: list[rows.Row] = []
    for name in compared_names(table):
        bias = table[f"bias:{name}"]
        in_band = "too few"
        if enough:
            in_band = "yes" if inside(table[f"rank:{name}"], RANKS + 1) else "NO"
        result.append(
            {
                "units": order,
                "parameter": name,
                "replicates": len(table),
                "ranks in 95 % band": in_band,
                "90 % interval covers": f"{table[f'in90:{name}'].mean():.3f}",
                "90 %, converged only": f"{good[f'in90:{name}'].mean():.3f}" if len(good) else "",
                "50 % interval covers": f"{table[f'in50:{name}'].mean():.3f}",
                "mean bias [sd]": f"{bias.mean():+.2f} ± {bias.sem():.2f}",
                "median sd of the logarithm": f"{table[f'sd:{name}'].median():.2g}",
            }
        )
    return result
