"""Table II of the tubular actuator's paper: the inertial parameter under each load, (13)."""

from __future__ import annotations

from deabayes.experiment import FloatArray
from deabayes.papers import tubular as paper
from deabayes.papers.base import Analysis, Row, StudyContext, interval
from deabayes.papers.tubular.sources import STATED, prior_draws, stated, systems_with
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
    if not stated(context.specimen, (*MASSES, *SIZES)):
        return Analysis()
    loads = [record.metadata.get("load_g") for record in context.experiments]
    given = {float(load) for load in loads if isinstance(load, int | float)}
    rows = [
        first | load_row(load, drawn)
        for first, drawn in _sources(context)
        for load in sorted(given.union(paper.LOADS))
    ]
    return Analysis.of_rows({"table_2_inertial_parameter": rows})


def load_row(load: float, drawn: dict[str, FloatArray]) -> dict[str, float]:
    """Row of moving mass [g] and M [kg/m] under a load [g]."""
    mass = drawn["moving_mass"] + GRAM * load
    parameter = mass * drawn["active_length"] / drawn["cross_section"]
    return {
        "load_g": load,
        **interval("moving_mass", "g", mass / GRAM),
        **interval("inertial_parameter", "kgm", parameter),
    }


def _sources(context: StudyContext) -> list[tuple[Row, dict[str, FloatArray]]]:
    """First columns of a row, and draws of the moving mass without load and of the sizes."""
    rng = context.rng("inertial_parameter")
    given = prior_draws(context.specimen, (*MASSES, *SIZES), rng)
    given["moving_mass"] = moving_mass(*(given[name] for name in MASSES))
    sources: list[tuple[Row, dict[str, FloatArray]]] = [(dict(STATED), given)]
    for first, fitted, system in systems_with(context, "inertia"):
        names = ("moving_mass", *SIZES)
        sources.append((first, {name: system.quantity(name, fitted.draws) for name in names}))
    return sources
