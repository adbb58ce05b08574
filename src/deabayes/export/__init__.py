"""Export of posteriors to formats of other programs; every format has one entry here."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from deabayes.export import abaqus, ansys, state_space
from deabayes.export.draws import write_csv, write_json, write_mat, write_parquet
from deabayes.export.priors import write_numpyro, write_pymc
from deabayes.faults import UserError, nearest
from deabayes.files import write_atomically

REGISTRY: dict[str, Callable[..., Sequence[str] | None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "json": write_json,
    "mat": write_mat,
    "state-space": state_space.write,
    "abaqus": abaqus.write,
    "ansys": ansys.write,
    "pymc": write_pymc,
    "numpyro": write_numpyro,
}
"""Format -> function with the arguments (tree, path, *, options of the format).

`path` is a temporary file. A function with the option `suffix` gets the ending of the requested
file. A function may return warnings about what it wrote.
"""
ENDINGS: dict[str, tuple[str, ...]] = {
    "csv": (".csv",),
    "parquet": (".parquet",),
    "json": (".json",),
    "mat": (".mat",),
    "abaqus": (".inp",),
    "ansys": (".mac", ".inp"),
    "pymc": (".py",),
    "numpyro": (".py",),
}
"""Format -> its usual file endings; files of other formats must not have them."""
OF_OTHER_PROGRAMS = (".xlsx", ".xls", ".nc", ".tdms")
"""Refused file endings: programs that open such files cannot read an export."""


def export(tree: xr.DataTree, to: str, output: Path, **options: Any) -> list[str]:
    """Write the posterior in `tree` to `output` in the format named `to`; return warnings.

    Parameters
    ----------
    **options : options of the format, see its module; None counts as not given.

    Raises
    ------
    UserError
        If the format is unknown or does not take an option, or if `output` has an ending of
        another format.
    """
    if to not in REGISTRY:
        raise UserError(f"--to {to!r} is no export format{nearest(to, REGISTRY)}")
    output, given = Path(output), {name: v for name, v in options.items() if v is not None}
    for name in given:
        takers = [form for form in REGISTRY if name in _options(form)]
        if to not in takers:
            option = f"--{name.replace('_', '-')}"
            raise UserError(
                f"{option} belongs to --to {' or '.join(takers) or '(no format)'}; "
                f"--to {to} takes no such option"
            )
    foreign = {ending for endings in (*ENDINGS.values(), OF_OTHER_PROGRAMS) for ending in endings}
    if "suffix" not in _options(to) and output.suffix.lower() in foreign.difference(ENDINGS[to]):
        usual = " or ".join(ENDINGS[to])
        raise UserError(f"-o {output}: --to {to} writes {usual}; correct the one or the other")
    if "suffix" in _options(to):
        given["suffix"] = output.suffix
    cautions: list[str] = []
    write_atomically(lambda path: cautions.extend(REGISTRY[to](tree, path, **given) or ()), output)
    return cautions


def _options(to: str) -> list[str]:
    parameters = inspect.signature(REGISTRY[to]).parameters.values()
    return [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
