"""Material cards of finite element programs: the solid of one draw, with comments."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.export.taken import evenly, system_and_draws, whose
from deabayes.faults import UserError
from deabayes.systems import Draws, System
from deabayes.systems.solid import Solid

MIDDLE, WIDE = (0.25, 0.75), (0.05, 0.5, 0.95)
WIDTH = 96
LONGEST_NAME = 60


@dataclass(frozen=True)
class Card:
    """One material in SI units; `Solid` explains the attributes not listed here.

    Attributes
    ----------
    number : number of the card, from 1.
    name : letters, digits and `_`, starting with a letter.
    moduli, before_relaxation : the law's coefficients in Pa as in `Solid.moduli`, and before
        relaxation.
    comments : sentences for this card.
    """

    number: int
    name: str
    law: str
    moduli: Mapping[str, float]
    before_relaxation: Mapping[str, float]
    others: Mapping[str, float]
    instantaneous: bool
    shares: Sequence[float]
    times: Sequence[float]
    density: float | None
    invariant: float | None
    comments: tuple[str, ...]


Lines = Callable[[Card], list[str]]


@dataclass(frozen=True)
class Program:
    """How cards are written for one program.

    Attributes
    ----------
    mark : start of a comment line.
    said, of_relaxation : sentences for all files, and for files of solids with relaxation.
    lines : function that writes a card in the program's format.
    """

    mark: str
    said: tuple[str, ...]
    of_relaxation: tuple[str, ...]
    lines: Lines


def write_cards(tree: xr.DataTree, path: Path, draws: int | None, program: Program) -> None:
    """Write one card of the medians, or cards of `draws` draws."""
    system, values = system_and_draws(tree)
    every = _solid(system, values)
    picked = None if draws is None else evenly(every.relaxed.size, draws)
    taken = {
        name: np.array([np.median(given)]) if picked is None else given[picked]
        for name, given in values.items()
    }
    solid = _solid(system, taken)
    _check_finite(solid)
    notes = [note.text for note in solid.notes if not note.values]
    mark, relaxing = program.mark, program.of_relaxation if solid.times.size else ()
    blocks = [commented([*_header(tree, every, picked), *notes, *program.said, *relaxing], mark)]
    for k in range(solid.relaxed.size):
        card = _card(tree, solid, every, k, picked)
        blocks.append([*commented(card.comments, mark), *program.lines(card)])
    text = "\n".join(line for block in blocks for line in [*block, mark]) + "\n"
    path.write_text(text, encoding="ascii", errors="replace")


def _solid(system: System, draws: Draws) -> Solid:
    """Return the solid that a system describes; refuse systems without one."""
    solid = system.solid(draws)
    if solid is None:
        raise UserError(
            f"{system.candidate} of system {system.name!r} describes no solid, so there is no "
            "material card; export its draws with --to json or --to csv"
        )
    return solid


def _check_finite(solid: Solid) -> None:
    """Check that the numbers of all cards are finite."""
    noted = [values for note in solid.notes for values in note.values.values()]
    numbers = [*solid.moduli.values(), *solid.others.values(), solid.relaxed, *noted]
    lost = int(np.sum(~np.all(np.isfinite(np.column_stack([*numbers, solid.times])), axis=1)))
    if lost:
        raise UserError(
            f"{lost} of {solid.relaxed.size} cards would hold no finite numbers; look at the "
            "posterior's draws with --to csv"
        )


def _header(tree: xr.DataTree, every: Solid, picked: NDArray[np.intp] | None) -> list[str]:
    """Return the file's first comments: candidate, provenance, convergence, units, draws."""
    attrs, total = tree.attrs, every.relaxed.size
    simulated = attrs["provenance"] == "simulated"
    taken = f"Medians of {total} draws, each parameter's own"
    if picked is not None:
        taken = f"{picked.size} of {total} draws, taken evenly: a card each, numbered from 1"
    intervals = []
    for kind, values in _told(every).items():
        low, median, high = np.nanquantile(values, WIDE)
        intervals.append(f"{kind} {median:.5g} Pa ({low:.5g} to {high:.5g})")
    return [
        f"deabayes {attrs['deabayes_version']}: {attrs['candidate']} of system "
        f"{attrs['system']}, {whose(tree)}",
        "Provenance: SIMULATED records, not measurements"
        if simulated
        else f"Provenance: {attrs['provenance']}",
        "Converged"
        if json.loads(attrs["convergence"])["converged"]
        else "NOT CONVERGED: do not use these numbers",
        "Units: SI (Pa, s, kg/m^3, stretches and shares 1)",
        taken,
        f"Shear modulus of all draws, median (90 % of them): {', '.join(intervals)}",
    ]


def _card(
    tree: xr.DataTree, solid: Solid, every: Solid, k: int, picked: NDArray[np.intp] | None
) -> Card:
    which = [] if picked is None else [_which(tree, int(picked[k]))]
    shear = _shear(solid, every, k, picked is None)
    own = [note.of(k) for note in solid.notes if note.values]

    def of(values: Mapping[str, FloatArray]) -> dict[str, float]:
        return {name: float(given[k]) for name, given in values.items()}

    return Card(
        k + 1,
        _name(tree.attrs["candidate"], "MEDIANS" if picked is None else f"{k + 1:04d}"),
        solid.law,
        of(solid.moduli),
        of(solid.instantaneous_moduli),
        of(solid.others),
        solid.instantaneous,
        solid.shares[k].tolist(),
        solid.times[k].tolist(),
        None if solid.density is None else float(solid.density[k]),
        None if solid.invariant is None else float(solid.invariant[k]),
        (*which, *shear, *own, *_density(solid)),
    )


def _name(candidate: str, ending: str) -> str:
    """Return a name that programs accept: letters, digits and `_`, starting with a letter."""
    name = re.sub(r"\W", "_", candidate, flags=re.ASCII)[:LONGEST_NAME].upper()
    return f"{name if name[0].isalpha() else f'M{name}'}_{ending}"


def _which(tree: xr.DataTree, row: int) -> str:
    ensemble, draw = divmod(row, tree["posterior"].sizes["draw"])
    return f"Ensemble {ensemble}, draw {draw} of the posterior file, both from 0"


def _shear(solid: Solid, every: Solid, k: int, medians: bool) -> list[str]:
    """Comment on the card's shear modulus, and a note if the medians are not a typical draw."""
    moduli = {kind: float(values[k]) for kind, values in _told(solid).items()}
    told = ", ".join(f"{kind} {own:.5g} Pa" for kind, own in moduli.items())
    said = [f"Shear modulus of this card: {told}"]
    for kind, values in _told(every).items():
        low, high = np.nanquantile(values, MIDDLE)
        if medians and not low <= moduli[kind] <= high:
            said.append(
                f"NOTE: the {kind} shear modulus of the medians is outside of the central 50 % of "
                f"the draws' ({low:.5g} to {high:.5g} Pa): parameters are correlated, and their "
                "medians together are no typical draw. Take cards of draws (--draws)"
            )
    return said


def _told(solid: Solid) -> dict[str, FloatArray]:
    """Shear moduli before and after relaxation; a solid without relaxation has only `long-term`."""
    before, after = solid.shear_moduli
    return (
        {"instantaneous": before, "long-term": after} if solid.times.size else {"long-term": after}
    )


def _density(solid: Solid) -> list[str]:
    return [] if solid.density is not None else ["Density: the specimen states none; add it"]


def commented(sentences: Sequence[str], mark: str) -> list[str]:
    """Return sentences as comment lines; continuation lines are indented."""
    wrapped = (
        textwrap.wrap(said, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
        for said in sentences
    )
    return [f"{mark} {line}" for lines in wrapped for line in lines]


def series(coefficients: Mapping[str, float], name: str) -> list[float]:
    """Return the coefficients `name_1`, `name_2`, ... in order."""
    count = sum(key.startswith(f"{name}_") for key in coefficients)
    return [coefficients[f"{name}_{i}"] for i in range(1, count + 1)]


def written(law: str, known: Mapping[str, Lines], program: str) -> Lines:
    """Return the function that writes a law in a program's format.

    Raises
    ------
    UserError : the program's format for this law is not known.
    """
    if law not in known:
        raise UserError(
            f"no card of {program} is known for the law {law!r}, only for {', '.join(known)}; "
            "export the draws with --to json or --to csv"
        )
    return known[law]
