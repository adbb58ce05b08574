"""Table 4 of the minimum-energy structure's paper: its Maxwell units and its friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, interval, labels
from deabayes.posteriors.fitted import Fitted

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Maxwell units and friction (Table 4)"
CAPTION = (
    "Stiffness k, relaxation time τ = ξ/k and viscosity ξ of each Maxwell unit, fastest first, and "
    "the friction of the slider: medians with 5 to 95 % intervals. The paper tuned its four units "
    "and η0 by hand, on a specimen of its own; its figures stand beside candidates with as many "
    "units."
)


def compute(context: StudyContext) -> Analysis:
    """Return one row per Maxwell unit, and one row per candidate for the friction."""
    import pandas as pd

    moving = {n: f for n, f in context.candidates.items() if "tau_1" in f.draws}
    units = [labels(n, f) | row for n, f in moving.items() for row in unit_rows(f)]
    friction = [{**labels(n, f), **friction_row(f)} for n, f in moving.items()]
    tables = {"table_4_units": units, "table_4_friction": friction}
    return Analysis({name: pd.DataFrame(rows) for name, rows in tables.items() if rows})


def unit_rows(fitted: Fitted) -> Iterator[dict[str, object]]:
    """Rows of k_i, tau_i and xi_i of each Maxwell unit."""
    draws, count = fitted.draws, sum(name.startswith("tau_") for name in fitted.draws)
    for i in range(1, count + 1):
        stiffness, time = draws[f"k_{i}"], draws[f"tau_{i}"]
        k, xi = np.nan, np.nan
        if count == len(paper.STIFFNESS):
            k, xi = paper.STIFFNESS[i - 1], paper.VISCOSITY[i - 1]
        yield {
            "unit": i,
            **interval("k", "Nperm", stiffness),
            "paper_k_Nperm": k,
            **interval("tau", "s", time),
            "paper_tau_s": xi / k,
            **interval("xi", "Nsperm", stiffness * time),
            "paper_xi_Nsperm": xi,
        }


def friction_row(fitted: Fitted) -> Mapping[str, object]:
    """Row of eta_0, or of F_c for dry friction."""
    if "eta_0" not in fitted.draws:
        return interval("dry_friction", "mN", 1e3 * fitted.draws["friction_force"])
    return interval("eta_0", "Nsperm", fitted.draws["eta_0"]) | {"paper_eta_0_Nsperm": paper.ETA_0}
