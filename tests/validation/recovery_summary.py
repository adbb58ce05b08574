"""Tables and figures of the recovery of one model each, of whatever has been run."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pandas as pd

from tests.validation import rank_figure, structure_recovery, tubular_recovery
from tests.validation.membrane_recovery import RANKS
from tests.validation.membrane_summary import FEWEST_FOR_BAND, coverage, parameter_table, parameters


class Checked(NamedTuple):
    """A model whose recovery is checked: a name for its files, a title, its order, its rows."""

    name: str
    title: str
    order: int
    stored: Path


def checked(folder: Path) -> list[Checked]:
    """What `make validate` runs."""
    structure = structure_recovery.path_of
    return [
        Checked(
            "tubular_recovery", "tubular voigt_kelvin_2_inertia_circuit, joint fit",
            tubular_recovery.UNITS, tubular_recovery.path_of(folder),
        ),
        *(
            Checked(
                f"structure_recovery_rest_{order}",
                f"minimum-energy structure ogden_{order}, forces at rest",
                order, structure("rest", order, folder),
            )
            for order in (1, 2)
        ),
        *(
            Checked(
                f"structure_recovery_motion_{order}",
                f"minimum-energy structure ogden_1_units_{order}, sines",
                order, structure("motion", order, folder),
            )
            for order in (1, 2)
        ),
    ]  # fmt: skip


def write(folder: Path) -> list[str]:
    """Write tables and figures of what has replicates; return what is missing."""
    missing = []
    for model in checked(folder):
        if not model.stored.exists():
            missing.append(model.stored.name)
            continue
        table = pd.read_csv(model.stored)
        for name, found in (
            (f"{model.name}.csv", recovery_table(table)),
            (f"{model.name}_parameters.csv", parameter_table(model.order, table)),
        ):
            found.to_csv(folder / name, index=False)
            print(f"\n{name}\n{found.to_string(index=False)}")
        if len(table) >= FEWEST_FOR_BAND:
            ranks = {
                n: {"posterior ranks": table[f"rank:{n}"].to_numpy()} for n in parameters(table)
            }
            title = f"{model.title}: {len(table)} simulated specimens"
            rank_figure.draw(title, ranks, RANKS + 1, folder / f"{model.name}.png")
    return missing


def recovery_table(table: pd.DataFrame) -> pd.DataFrame:
    """Coverage of the material parameters and of held-out records, of all and of converged runs."""
    good = table[table["converged"] == 1]
    held_out = [name.removeprefix("held90:") for name in table if name.startswith("held90:")]
    row: dict[str, object] = {"replicates": len(table), "converged": len(good)}
    for level in (90, 50):
        row[f"coverage of {level} % intervals"] = coverage(table, level)
        row[f"{level} %, converged only"] = coverage(good, level)
        for name in held_out:
            row[f"{level} % band covers {name}"] = f"{table[f'held{level}:{name}'].mean():.3f}"
    row["median CPU s"] = f"{table['cpu_seconds'].median():.0f}"
    row["seed"], row["deabayes"] = table["seed"].iloc[0], table["deabayes"].iloc[-1]
    return pd.DataFrame([row])
