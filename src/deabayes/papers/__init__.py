"""Analyses of the papers' results, computed from a study's posteriors; one module each.

An analysis module defines `SYSTEMS` (the systems it applies to; empty for all), `TITLE` and
`CAPTION` (of its section and tables in the report), and `compute(context)`, which returns an
`Analysis`. Figures read the files written here and compute nothing themselves.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from deabayes.faults import UserError, nearest

if TYPE_CHECKING:
    from deabayes.papers.base import Analysis, StudyContext

REGISTRY: Mapping[str, str] = {
    "membrane_table_1": "deabayes.papers.membrane.membrane_table_1",
    "error_against_time": "deabayes.papers.membrane.error_against_time",
    "membrane_table_2": "deabayes.papers.membrane.membrane_table_2",
    "response_stages": "deabayes.papers.membrane.response_stages",
    "structure_film": "deabayes.papers.minimum_energy_structure.structure_film",
    "force_curve": "deabayes.papers.minimum_energy_structure.force_curve",
    "genetic_algorithm": "deabayes.papers.minimum_energy_structure.genetic_algorithm",
    "structure_units": "deabayes.papers.minimum_energy_structure.structure_units",
    "structure_errors": "deabayes.papers.minimum_energy_structure.structure_errors",
    "hysteresis": "deabayes.papers.hysteresis",
    "error_against_phase": "deabayes.papers.minimum_energy_structure.error_against_phase",
    "structure_amplitude": "deabayes.papers.minimum_energy_structure.structure_amplitude",
    "amplitude_frequency": "deabayes.papers.membrane.amplitude_frequency",
    "pull_in": "deabayes.papers.membrane.pull_in",
    "influence": "deabayes.papers.membrane.influence",
    "inertial_parameter": "deabayes.papers.tubular.inertial_parameter",
    "circuit": "deabayes.papers.tubular.circuit",
    "resonance": "deabayes.papers.tubular.resonance",
    "amplifier_current": "deabayes.papers.tubular.amplifier_current",
}
"""Module of each analysis, in the order of the report."""

INDEX = "index.json"
TABLES_OF_EVERY_STUDY = ("errors", "summary", "comparison")


def module(name: str) -> ModuleType:
    """Return the module of a registered analysis."""
    if name not in REGISTRY:
        raise UserError(f"no analysis is called {name!r}{nearest(name, REGISTRY)}")
    return import_module(REGISTRY[name])


def names_for(system: str) -> list[str]:
    """Names of the registered analyses of a system, in the order of the registry."""
    return [name for name in REGISTRY if not module(name).SYSTEMS or system in module(name).SYSTEMS]


def run_all(context: StudyContext, output: Path) -> list[str]:
    """Compute every analysis of the study's system and write them to the folder `output`.

    The files are `{name}/{table}.csv`, `{name}/{curve}.nc`, and `index.json`, which lists the
    analyses with titles and captions. If an analysis fails, `output` stays as it was.

    Returns
    -------
    list of str
        The names of the analyses.
    """
    from deabayes.files import write_text_atomically

    output = Path(output)
    unfinished = output.with_name(f".{output.name}.tmp")
    shutil.rmtree(unfinished, ignore_errors=True)
    entries, names = [], names_for(context.specimen.system)
    used = set(TABLES_OF_EVERY_STUDY)
    for name in names:
        source = module(name)
        analysis: Analysis = source.compute(context)
        if repeated := used & set(analysis.tables):
            raise ValueError(f"analysis {name}: a table {repeated.pop()!r} exists already")
        used |= set(analysis.tables)
        analysis.write(unfinished / name)
        entries.append(
            {
                "name": name,
                "title": source.TITLE,
                "caption": source.CAPTION,
                "tables": list(analysis.tables),
                "curves": list(analysis.curves),
            }
        )
    write_text_atomically(json.dumps(entries, indent=1), unfinished / INDEX)
    shutil.rmtree(output, ignore_errors=True)
    unfinished.replace(output)
    return names
