"""The header of experiments.csv: which columns must be there, and which are misspelt."""

from __future__ import annotations

from collections import Counter
from difflib import get_close_matches
from pathlib import Path

from deabayes.faults import rename_hint
from deabayes.reading.schema import schema
from deabayes.systems import system_class

NUMBERS = ("load_g", "bias_kV", "voltage_kV", "frequency_Hz", "amplitude_kV")
READ_BY_MODELS = (*NUMBERS, "deformation", "prehistory", "columns")
"""Columns that need not be there and count where they are."""
OF_ANY_RECORD = ("frequency_Hz", "columns")
OF_A_VOLTAGE = ("voltage_kV", "amplitude_kV")
ALIKE = 0.82
"""Similarity from which another name is taken for a misspelt one of these."""


def header_faults(header: list[str], path: Path) -> list[str]:
    """Columns that are missing, given twice, or all in one."""
    required = schema("experiments")["required"]
    missing = [name for name in required if name not in header]
    unknown = [h for h in header if h and h not in (*required, *READ_BY_MODELS, "note")]
    faults = [
        f"{path}: column {name!r} is missing{rename_hint(name, unknown) or '; add it'}"
        for name in missing
    ]
    if missing and len(header) == 1:
        return [f"{path}: only one column found; separate columns with a comma, ';' or a tab"]
    repeated = [name for name, count in Counter(h for h in header if h).items() if count > 1]
    return faults + [f"{path}: column {name!r} occurs twice; remove one" for name in repeated]


def misspelt(header: list[str], path: Path, system: str | None) -> list[str]:
    """Columns that would be passed over for their spelling or unit."""
    spelling = {name.lower(): name for name in READ_BY_MODELS}
    read = {name.lower(): name for name in _read_by(system)}
    stems = {name.partition("_")[0]: name for name in read.values()}
    faults = []
    for name in header:
        low = name.lower()
        close = [read[each] for each in get_close_matches(low, read, 1, ALIKE)]
        meant = spelling.get(low) or stems.get(low) or next(iter(close), None)
        if meant and name not in READ_BY_MODELS and meant not in header:
            faults.append(
                f"{path}: no model reads column {name!r}; did you mean {meant!r}? Rename it so, "
                "with values in that unit, or give it a less similar name"
            )
    return faults


def _read_by(system: str | None) -> tuple[str, ...]:
    """Columns whose misspelling matters to a system; one of the user's own may read any."""
    from deabayes.systems import OWN, REGISTRY

    if system in OWN:
        return ()
    if system not in REGISTRY:
        return READ_BY_MODELS
    kind = system_class(system)
    held = {name for names in (kind.conditions or {}).values() for name in names}
    driven = OF_A_VOLTAGE if "voltage" in {*held, *kind.excitations} else ()
    return tuple(n for n in READ_BY_MODELS if n in (*held, *driven, *OF_ANY_RECORD))
