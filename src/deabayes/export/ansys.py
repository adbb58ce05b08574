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

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr

from deabayes.export.cards import Card, Lines, Program, commented, series, write_cards, written
from deabayes.systems.solid import LINEAR

MARK = "!"
PER_LINE = 6
SAID = (
    "ANSYS: read this file in /PREP7 (/INPUT). Materials are numbered from 1: number them anew "
    "where the model has these",
)
OF_RELAXATION = (
    "The constants of the law are those before relaxation: after it they are 1 - sum of shares of "
    "that",
)
INCOMPRESSIBLE = (
    "d = 0: incompressible. Solid elements need the mixed u-P formulation for it (SOLID185 to "
    "187: KEYOPT(6) = 1) unless stress is plane",
)


def write(tree: xr.DataTree, path: Path, *, draws: int | None = None) -> None:
    """Write cards for `/INPUT`, with one material number per card.

    Parameters
    ----------
    draws : number of draws, with one card per draw; by default one card of the medians.

    Raises
    ------
    UserError
        If the candidate describes no solid, or the posterior has fewer draws.
    """
    write_cards(tree, path, draws, Program(MARK, SAID, OF_RELAXATION, _lines))


def _lines(card: Card) -> list[str]:
    lines = [f"! {card.name}"]
    if card.density is not None:
        lines.append(f"MP,DENS,{card.number},{card.density:.9g}")
    lines += written(card.law, LAWS, "ANSYS")(card)
    if card.shares:
        pairs = zip(card.shares, card.times, strict=True)
        lines.append(f"TB,PRONY,{card.number},1,{len(card.shares)},SHEAR")
        lines += _data([value for pair in pairs for value in pair])
    return lines


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
    return [
        *commented(INCOMPRESSIBLE, MARK),
        f"TB,HYPER,{card.number},1,,NEO",
        *_data([card.before_relaxation["mu"], 0.0]),
    ]


def _gent(card: Card) -> list[str]:
    """Gent card with the constants mu, J_m, d."""
    return [
        *commented(INCOMPRESSIBLE, MARK),
        f"TB,HYPER,{card.number},1,,GENT",
        *_data([card.before_relaxation["mu"], card.others["J"], 0.0]),
    ]


def _ogden(card: Card) -> list[str]:
    """Ogden card with mu_1, alpha_1, ..., then d_1, ...; the energy is defined as ours."""
    terms = series(card.before_relaxation, "mu")
    pairs = zip(terms, series(card.others, "alpha"), strict=True)
    data = [value for pair in pairs for value in pair]
    return [
        *commented(INCOMPRESSIBLE, MARK),
        f"TB,HYPER,{card.number},1,{len(terms)},OGDEN",
        *_data([*data, *[0.0] * len(terms)]),
    ]


LAWS: Mapping[str, Lines] = {
    LINEAR: _linear,
    "gent": _gent,
    "neo_hookean": _neo_hookean,
    "ogden": _ogden,
}
