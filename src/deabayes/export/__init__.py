"""Export of posteriors to formats of other programs; every format has one entry here."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from deabayes.faults import UserError, nearest
from deabayes.files import write_atomically

if TYPE_CHECKING:
    import xarray as xr


class Format(NamedTuple):
    """One export format.

    Attributes
    ----------
    module, function : writes the posterior, called as `function(tree, path, **options)`. It may
        return warnings about what it wrote. `path` is a temporary file.
    endings : usual endings of such files; files of other formats must not have them.
    options : keyword arguments that the function takes. `suffix` gets the ending of the requested
        file, the others come from the user.
    """

    module: str
    function: str
    endings: tuple[str, ...]
    options: tuple[str, ...] = ()


REGISTRY = {
    "csv": Format("draws", "write_csv", (".csv",)),
    "parquet": Format("draws", "write_parquet", (".parquet",)),
    "json": Format("draws", "write_json", (".json",)),
    "mat": Format("draws", "write_mat", (".mat",)),
    "state-space": Format(
        "state_space", "write", (".json", ".mat"), ("suffix", "rate", "draws", "load_g", "bias")
    ),
    "abaqus": Format("abaqus", "write", (".inp",), ("draws",)),
    "ansys": Format("ansys", "write", (".mac", ".inp"), ("draws",)),
    "pymc": Format("priors", "write_pymc", (".py",)),
    "numpyro": Format("priors", "write_numpyro", (".py",)),
}
"""Format by name. Modules are imported on use, so that the command line starts fast."""
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
    output, chosen = Path(output), REGISTRY[to]
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in chosen.options:
            takers = [known for known, form in REGISTRY.items() if name in form.options]
            remedy = f"only --to {' or '.join(takers)} does" if takers else "leave it out"
            raise UserError(f"--to {to} takes no option --{name.replace('_', '-')}; {remedy}")
    if "suffix" in chosen.options:
        given["suffix"] = output.suffix
    else:
        _check_ending(output, to)
    write = getattr(import_module(f"deabayes.export.{chosen.module}"), chosen.function)
    warnings: list[str] = []
    write_atomically(lambda path: warnings.extend(write(tree, path, **given) or ()), output)
    return warnings


def _check_ending(output: Path, to: str) -> None:
    """Refuse a file whose ending is usual for another format."""
    known = {ending for form in REGISTRY.values() for ending in form.endings}
    usual = REGISTRY[to].endings
    if output.suffix.lower() in known.union(OF_OTHER_PROGRAMS).difference(usual):
        raise UserError(
            f"-o {output}: --to {to} writes {' or '.join(usual)} files; change the ending or --to"
        )
