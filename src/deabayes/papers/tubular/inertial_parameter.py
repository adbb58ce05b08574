"""Table II of the tubular actuator's paper: the inertial parameter under each load, (13)."""

from __future__ import annotations

from deabayes.experiment import FloatArray
from deabayes.papers import tubular as paper
from deabayes.papers.base import Analysis, StudyContext, interval
from deabayes.papers.tubular.sources import STATED, Labels, having, prior_draws, sourced, stated
from deabayes.systems.tubular.base import MASSES, moving_mass

SYSTEMS = ("tubular",)
TITLE = "Inertial parameter (Table II)"
CAPTION = (
    "M = (m_DE + m_LVDT + m_LOAD) L0/A0, (13), with m_DE the active mass and half of the rest, "
    "under the paper's loads and those of the records: medians with 5 to 95 % intervals. "
    "specimen.yaml: from the masses and sizes as stated, before any record; a candidate that was "
    "fitted with inertia: from its posterior; one that is only predicted with it: the mass from "
    "its prior. The paper's own table is not in its text."
)
SIZES = ("cross_section", "active_length")
GRAM = 1e-3


def compute(context: StudyContext) -> Analysis:
    """Return one row per load, for the stated values and for every candidate with inertia."""
    import pandas as pd

    if not stated(context.specimen, (*MASSES, *SIZES)):
        return Analysis()
    rows = [
        first | row
        for first, drawn in _sources(context)
        for row in (load_row(load, drawn) for load in _loads(context))
    ]
    return Analysis({"table_2_inertial_parameter": pd.DataFrame(rows)})


def load_row(load: float, drawn: dict[str, FloatArray]) -> dict[str, float]:
    """Row of moving mass [g] and M [kg/m] under a load [g]."""
    mass = drawn["moving_mass"] + GRAM * load
    parameter = mass * drawn["active_length"] / drawn["cross_section"]
    return {
        "load_g": load,
        **interval("moving_mass", "g", mass / GRAM),
        **interval("inertial_parameter", "kgm", parameter),
    }


def _sources(context: StudyContext) -> list[tuple[Labels, dict[str, FloatArray]]]:
    rng = context.rng("inertial_parameter")
    given = prior_draws(context.specimen, (*MASSES, *SIZES), rng)
    given["moving_mass"] = moving_mass(*(given[name] for name in MASSES))
    found: list[tuple[Labels, dict[str, FloatArray]]] = [(dict(STATED), given)]
    for name, fitted in context.candidates.items():
        system = having(fitted, "inertia")
        if system is not None:
            names = ("moving_mass", *SIZES)
            drawn = {each: system.quantity(each, fitted.draws) for each in names}
            found.append((sourced(name, fitted, system), drawn))
    return found


def _loads(context: StudyContext) -> list[float]:
    """Loads of the paper and of the records [g]."""
    hung = [each.metadata.get("load_g") for each in context.experiments]
    given = [float(load) for load in hung if isinstance(load, int | float)]
    return sorted({*paper.LOADS, *given})
