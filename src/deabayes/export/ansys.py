r"""Material cards of Mechanical APDL (ANSYS).

The energies in ANSYS, with deviatoric stretches l_i and the first invariant I_1 of them:

OGDEN  W = sum_i (mu_i/alpha_i) (l_1^alpha_i + l_2^alpha_i + l_3^alpha_i - 3)
GENT   W = -(mu J_m/2) log(1 - (I_1 - 3)/J_m)
NEO    W = (mu/2) (I_1 - 3)

plus volumetric terms with d; d = 0 is incompressible. The constants are those before relaxation.
TB,PRONY,,,,SHEAR takes alpha_i, tau_i of G(t)/G(0) = 1 - sum_i alpha_i (1 - exp(-t/tau_i))
(Material Reference, hyperelasticity and viscoelasticity).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from deabayes.export.cards import Card, Program, commented, series, write_cards
from deabayes.systems.solid import LINEAR

MARK = "!"
PER_LINE = 6
INCOMPRESSIBLE = (
    "d = 0: incompressible. Solid elements then need the mixed u-P formulation (SOLID185 to 187: "
    "KEYOPT(6) = 1), except in plane stress"
)


def write(tree: xr.DataTree, path: Path, *, draws: int | None = None) -> None:
    """Write cards for `/INPUT`, with one material number per card; see `write_cards`.

    Parameters
    ----------
    draws : number of draws, with one card per draw; by default one card of the medians.
    """
    write_cards(tree, path, draws, ANSYS)


def _opening(card: Card) -> list[str]:
    density = [] if card.density is None else [f"MP,DENS,{card.number},{card.density:.9g}"]
    return [f"! {card.name}", *density]


def _relaxation(card: Card) -> list[str]:
    terms = zip(card.shares, card.times, strict=True)
    return [
        f"TB,PRONY,{card.number},1,{len(card.shares)},SHEAR",
        *_data([value for term in terms for value in term]),
    ]


def _hyperelastic(
    card: Card, law: str, constants: Sequence[float], terms: int | str = ""
) -> list[str]:
    """Lines of a hyperelastic law, with a comment on incompressibility."""
    return [
        *commented([INCOMPRESSIBLE], MARK),
        f"TB,HYPER,{card.number},1,{terms},{law}",
        *_data(constants),
    ]


def _data(values: Sequence[float]) -> list[str]:
    """TBDATA lines of at most six values; every line states the position of its first value."""
    return [
        f"TBDATA,{k + 1}," + ",".join(f"{value:.9g}" for value in values[k : k + PER_LINE])
        for k in range(0, len(values), PER_LINE)
    ]


def _linear(card: Card) -> list[str]:
    return [
        f"MP,EX,{card.number},{card.before_relaxation['E']:.9g}",
        f"MP,PRXY,{card.number},{card.others['nu']:.9g}",
    ]


def _neo_hookean(card: Card) -> list[str]:
    """Neo-Hookean card with the constants mu, d."""
    return _hyperelastic(card, "NEO", [card.before_relaxation["mu"], 0.0])


def _gent(card: Card) -> list[str]:
    """Gent card with the constants mu, J_m, d."""
    return _hyperelastic(card, "GENT", [card.before_relaxation["mu"], card.others["J"], 0.0])


def _ogden(card: Card) -> list[str]:
    """Ogden card with mu_1, alpha_1, ..., then d_1, ...; the energy is defined as ours."""
    moduli, exponents = series(card.before_relaxation, "mu"), series(card.others, "alpha")
    constants = [value for pair in zip(moduli, exponents, strict=True) for value in pair]
    return _hyperelastic(card, "OGDEN", [*constants, *[0.0] * len(moduli)], len(moduli))


ANSYS = Program(
    name="ANSYS",
    mark=MARK,
    usage=(
        "ANSYS: read this file in /PREP7 (/INPUT). Materials are numbered from 1: renumber them if "
        "the model already has these numbers"
    ),
    usage_of_relaxation=(
        "The constants of the law hold before relaxation. After it they are smaller by the factor "
        "1 - sum of shares"
    ),
    opening=_opening,
    relaxation=_relaxation,
    laws={LINEAR: _linear, "gent": _gent, "neo_hookean": _neo_hookean, "ogden": _ogden},
)
