"""Draws as a MATLAB struct."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from deabayes.export.taken import converged, draws_table, stated, units
from deabayes.faults import UserError

LONGEST_NAME = 63


def write(tree: xr.DataTree, path: Path) -> None:
    """Structs `draws`, `units` and `names`, their fields named as MATLAB allows (see `fields`).

    And `about`: `candidate`, `system`, `provenance`, `deabayes_version`, logical `converged`.

    Raises
    ------
    UserError : a name longer than MATLAB allows.
    """
    from scipy.io import savemat

    table = draws_table(tree)
    of = fields([str(name) for name in table.columns])
    draws = {of[str(name)]: table[name].to_numpy() for name in table.columns}
    labels = {of[name]: unit for name, unit in units(tree).items()}
    names = {found: name for name, found in of.items()}
    about = {**stated(tree), "converged": converged(tree)}
    content = {"draws": draws, "units": labels, "names": names, "about": about}
    with path.open("wb") as stream:
        savemat(stream, content, long_field_names=True)


def fields(names: Sequence[str]) -> dict[str, str]:
    """Quantity -> field: `__` for a dot, `_` for other signs, `x` before a first digit.

    Of names that differ in such signs only, the later ones end in `_1`, `_2`, as those of
    MATLAB's `makeUniqueStrings`.
    """
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name.replace(".", "__"), flags=re.ASCII)
        plain = plain if plain[0].isalpha() else f"x{plain}"
        choices = itertools.chain([plain], (f"{plain}_{k}" for k in itertools.count(1)))
        found[name] = next(each for each in choices if each not in found.values())
        if len(found[name]) > LONGEST_NAME:
            raise UserError(
                f"{name} is longer than the {LONGEST_NAME} characters of a name in MATLAB; export "
                "to csv or json"
            )
    return found
