"""Tables and figure of the tubular actuator's recovery, of whatever has been run."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from tests.validation import rank_figure, tubular_recovery
from tests.validation.membrane_recovery import RANKS
from tests.validation.membrane_summary import FEWEST_FOR_BAND, coverage, parameter_table, parameters

TITLE = "tubular voigt_kelvin_2_inertia_circuit, joint fit"


def write(folder: Path) -> list[str]:
    """Write the tables and the figure if there are replicates; return what is missing."""
    stored = tubular_recovery.path_of(folder)
    if not stored.exists():
        return [stored.name]
    table = pd.read_csv(stored)
    for name, found in (
        ("tubular_recovery.csv", recovery_table(table)),
        ("tubular_recovery_parameters.csv", parameter_table(tubular_recovery.UNITS, table)),
    ):
        found.to_csv(folder / name, index=False)
        print(f"\n{name}\n{found.to_string(index=False)}")
    if len(table) >= FEWEST_FOR_BAND:
        ranks = {n: {"posterior ranks": table[f"rank:{n}"].to_numpy()} for n in parameters(table)}
        title = f"{TITLE}: {len(table)} simulated specimens"
        rank_figure.draw(title, ranks, RANKS + 1, folder / "tubular_recovery.png")
    return []


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
