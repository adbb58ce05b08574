"""Table 4 of the minimum-energy structure's paper: its Maxwell units and its friction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, Row, StudyContext, interval, labels
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
    moving = {n: f for n, f in context.candidates.items() if "tau_1" in f.draws}
    units = [labels(n, f) | row for n, f in moving.items() for row in unit_rows(f)]
    friction = [labels(n, f) | friction_row(f) for n, f in moving.items()]
    return Analysis.of_rows({"table_4_units": units, "table_4_friction": friction})


def unit_rows(fitted: Fitted) -> Iterator[Row]:
    """Rows of k_i, tau_i and xi_i of each Maxwell unit."""
    draws, count = fitted.draws, paper.count_of("tau", fitted.draws)
    printed = [(np.nan, np.nan)] * count
    if count == len(paper.STIFFNESS):
        printed = list(zip(paper.STIFFNESS, paper.VISCOSITY, strict=True))
    for i, (paper_k, paper_xi) in enumerate(printed, start=1):
        k, tau = draws[f"k_{i}"], draws[f"tau_{i}"]
        yield {
            "unit": i,
            **interval("k", "Nperm", k),
            "paper_k_Nperm": paper_k,
            **interval("tau", "s", tau),
            "paper_tau_s": paper_xi / paper_k,
            **interval("xi", "Nsperm", k * tau),
            "paper_xi_Nsperm": paper_xi,
        }


def friction_row(fitted: Fitted) -> dict[str, float]:
    """Row of eta_0, or of F_c for dry friction."""
    if "eta_0" not in fitted.draws:
        return interval("dry_friction", "mN", 1e3 * fitted.draws["friction_force"])
    return interval("eta_0", "Nsperm", fitted.draws["eta_0"]) | {"paper_eta_0_Nsperm": paper.ETA_0}
