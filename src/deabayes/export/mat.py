"""Draws as a MATLAB struct."""

from __future__ import annotations

import re
from pathlib import Path

import xarray as xr

from deabayes.export.table import draws_table, units
from deabayes.faults import UserError

LONGEST_NAME = 63


def write(tree: xr.DataTree, path: Path) -> None:
    """Structs `draws` and `units`, their fields named as MATLAB allows (see `field`).

    Raises
    ------
    UserError : a name longer than MATLAB allows.
    """
    from scipy.io import savemat

    table = draws_table(tree)
    draws = {field(str(name)): table[name].to_numpy() for name in table.columns}
    labels = {field(name): unit for name, unit in units(tree).items()}
    with path.open("wb") as stream:
        savemat(stream, {"draws": draws, "units": labels}, long_field_names=True)


def field(name: str) -> str:
    """A quantity's name with `__` for a dot, `_` for other signs, `x` before a first digit."""
    found = re.sub(r"\W", "_", name.replace(".", "__"), flags=re.ASCII)
    found = found if found[0].isalpha() else f"x{found}"
    if len(found) > LONGEST_NAME:
        raise UserError(
            f"{name} is longer than the {LONGEST_NAME} characters of a name in MATLAB; export to "
            "csv or json"
        )
    return found
