"""Material cards of finite element programs: the solid of one draw, with comments."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.export.source import converged, evenly, provenance, system_and_draws, title
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
    name : name of the program.
    mark : start of a comment line.
    usage, usage_of_relaxation : sentences for all files, and for files of solids with relaxation.
    opening, relaxation : functions that write a card's lines before the law (name and density),
        and the Prony series.
    laws : name of a law -> function that writes its lines.
    """

    name: str
    mark: str
    usage: str
    usage_of_relaxation: str
    opening: Lines
    relaxation: Lines
    laws: Mapping[str, Lines]


def write_cards(tree: xr.DataTree, path: Path, draws: int | None, program: Program) -> None:
    """Write one card of the medians, or cards of `draws` draws.

    Raises
    ------
    UserError
        If the candidate describes no solid, the program has no card for its law, the posterior
        has fewer draws, or a card would hold numbers that are not finite.
    """
    system, values = system_and_draws(tree)
    all_draws = _solid(system, values)
    picked = None if draws is None else evenly(all_draws.relaxed.size, draws)
    solid = _solid(
        system,
        {
            name: np.array([np.median(drawn)]) if picked is None else drawn[picked]
            for name, drawn in values.items()
        },
    )
    _check_finite(solid)
    if solid.law not in program.laws:
        raise UserError(
            f"{program.name}: no card is known for the law {solid.law!r}, only for "
            f"{', '.join(program.laws)}; export the draws with --to json or --to csv"
        )
    header = [
        *_header(tree, all_draws, picked),
        *(note.text for note in solid.notes if not note.values),
        program.usage,
        *([program.usage_of_relaxation] if solid.times.size else []),
    ]
    lines = [*commented(header, program.mark), program.mark]
    for k in range(solid.relaxed.size):
        card = _card(tree, solid, all_draws, k, picked)
        lines += commented(card.comments, program.mark) + program.opening(card)
        lines += program.laws[card.law](card)
        lines += program.relaxation(card) if card.shares else []
        lines.append(program.mark)
    path.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")


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
            f"{lost} of {solid.relaxed.size} cards would hold numbers that are not finite; look "
            "at the posterior's draws with --to csv"
        )


def _header(tree: xr.DataTree, all_draws: Solid, picked: NDArray[np.intp] | None) -> list[str]:
    """Return the file's first comments: candidate, provenance, convergence, units, draws."""
    total = all_draws.relaxed.size
    source = f"Medians of {total} draws, of each parameter on its own"
    if picked is not None:
        source = f"{picked.size} of {total} draws, evenly spaced: one card each, numbered from 1"
    intervals = []
    for kind, values in _shear_moduli(all_draws).items():
        low, median, high = np.nanquantile(values, WIDE)
        intervals.append(f"{kind} {median:.5g} Pa ({low:.5g} to {high:.5g})")
    return [
        f"deabayes {tree.attrs['deabayes_version']}: {title(tree)}",
        provenance(tree),
        "Converged" if converged(tree) else "NOT CONVERGED: do not use these numbers",
        "Units: SI (Pa, s, kg/m^3, stretches and shares 1)",
        source,
        f"Shear modulus of all draws, median (90 % interval): {', '.join(intervals)}",
    ]


def _card(
    tree: xr.DataTree, solid: Solid, all_draws: Solid, k: int, picked: NDArray[np.intp] | None
) -> Card:
    comments = []
    if picked is not None:
        ensemble, draw = divmod(int(picked[k]), tree["posterior"].sizes["draw"])
        comments.append(f"Ensemble {ensemble}, draw {draw} of the posterior file, both from 0")
    comments += _on_shear_modulus(solid, all_draws, k, picked is None)
    comments += [note.of(k) for note in solid.notes if note.values]
    if solid.density is None:
        comments.append("Density: the specimen states none; add it")

    def of_draw(values: Mapping[str, FloatArray]) -> dict[str, float]:
        return {name: float(drawn[k]) for name, drawn in values.items()}

    return Card(
        k + 1,
        _name(tree.attrs["candidate"], "MEDIANS" if picked is None else f"{k + 1:04d}"),
        solid.law,
        of_draw(solid.moduli),
        of_draw(solid.instantaneous_moduli),
        of_draw(solid.others),
        solid.instantaneous,
        solid.shares[k].tolist(),
        solid.times[k].tolist(),
        None if solid.density is None else float(solid.density[k]),
        None if solid.invariant is None else float(solid.invariant[k]),
        tuple(comments),
    )


def _name(candidate: str, ending: str) -> str:
    """Return a name that programs accept: letters, digits and `_`, starting with a letter."""
    name = re.sub(r"\W", "_", candidate, flags=re.ASCII)[:LONGEST_NAME].upper()
    return f"{name if name[0].isalpha() else f'M{name}'}_{ending}"


def _on_shear_modulus(solid: Solid, all_draws: Solid, k: int, medians: bool) -> list[str]:
    """Comment on the card's shear modulus, and a note if the medians are not a typical draw."""
    moduli = {kind: float(values[k]) for kind, values in _shear_moduli(solid).items()}
    shown = ", ".join(f"{kind} {modulus:.5g} Pa" for kind, modulus in moduli.items())
    comments = [f"Shear modulus of this card: {shown}"]
    for kind, values in _shear_moduli(all_draws).items():
        low, high = np.nanquantile(values, MIDDLE)
        if medians and not low <= moduli[kind] <= high:
            comments.append(
                f"NOTE: the medians together are no typical draw, because parameters are "
                f"correlated. Their {kind} shear modulus lies outside the central 50 % of the "
                f"draws ({low:.5g} to {high:.5g} Pa). Write cards of draws instead (--draws)"
            )
    return comments


def _shear_moduli(solid: Solid) -> dict[str, FloatArray]:
    """Shear moduli before and after relaxation; a solid without relaxation has only `long-term`."""
    before, after = solid.shear_moduli
    return (
        {"instantaneous": before, "long-term": after} if solid.times.size else {"long-term": after}
    )


def commented(sentences: Sequence[str], mark: str) -> list[str]:
    """Return sentences as comment lines; continuation lines are indented."""
    wrapped = (
        textwrap.wrap(sentence, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
        for sentence in sentences
    )
    return [f"{mark} {line}" for lines in wrapped for line in lines]


def series(coefficients: Mapping[str, float], name: str) -> list[float]:
    """Return the coefficients `name_1`, `name_2`, ... in order."""
    count = sum(key.startswith(f"{name}_") for key in coefficients)
    return [coefficients[f"{name}_{i}"] for i in range(1, count + 1)]
