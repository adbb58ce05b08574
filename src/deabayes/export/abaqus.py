r"""Material cards of Abaqus.

The energies in Abaqus, with deviatoric stretches l_i and the first invariant I_1 of them:

OGDEN               U = sum_i (2 mu_i/alpha_i^2) (l_1^alpha_i + l_2^alpha_i + l_3^alpha_i - 3)
REDUCED POLYNOMIAL  U = sum_k C_k0 (I_1 - 3)^k

plus volumetric terms with D_i; D_i = 0 is incompressible. Relaxation is
g(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)), data lines g_i, k_i, tau_i (Abaqus Keywords Guide,
*HYPERELASTIC, *VISCOELASTIC; Materials Guide, hyperelasticity and time-domain viscoelasticity).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from deabayes.export.cards import Card, Program, commented, series, write_cards
from deabayes.systems.solid import LINEAR

MARK = "**"
ORDER = 6
"""Number of terms in the series of the Gent energy."""
PER_LINE = 8
CLOSE = 0.01
"""Largest relative error of the series' stress up to the stretches that the card states."""
INCOMPRESSIBLE = (
    "D_i = 0: incompressible. Abaqus/Standard then needs hybrid elements (C3D8H, CPE4H, ...) "
    "except in plane stress. Abaqus/Explicit refuses it: give D_1 = 2/bulk modulus"
)


def write(tree: xr.DataTree, path: Path, *, draws: int | None = None) -> None:
    """Write cards for `*INCLUDE`, with one `*MATERIAL` per card; see `write_cards`.

    Parameters
    ----------
    draws : number of draws, with one card per draw; by default one card of the medians.
    """
    write_cards(tree, path, draws, ABAQUS)


def _opening(card: Card) -> list[str]:
    density = [] if card.density is None else ["*DENSITY", f"{card.density:.9g},"]
    return [f"*MATERIAL, NAME={card.name}", *density]


def _relaxation(card: Card) -> list[str]:
    terms = zip(card.shares, card.times, strict=True)
    return ["*VISCOELASTIC, TIME=PRONY", *(f"{g:.9g}, 0., {tau:.9g}" for g, tau in terms)]


def _moduli(card: Card) -> str:
    """Option that says whether moduli are instantaneous or long-term; empty without relaxation."""
    if not card.shares:
        return ""
    return f", MODULI={'INSTANTANEOUS' if card.instantaneous else 'LONG TERM'}"


def _data(values: Sequence[float]) -> list[str]:
    """Data lines of at most eight values."""
    return [
        ", ".join(f"{value:.9g}" for value in values[k : k + PER_LINE])
        for k in range(0, len(values), PER_LINE)
    ]


def _hyperelastic(
    card: Card, law: str, constants: Sequence[float], terms: int, comments: Sequence[str] = ()
) -> list[str]:
    """Lines of a hyperelastic law: its constants, then D_i = 0 for every term."""
    return [
        *commented([*comments, INCOMPRESSIBLE], MARK),
        f"*HYPERELASTIC, {law}{_moduli(card)}",
        *_data([*constants, *[0.0] * terms]),
    ]


def _linear(card: Card) -> list[str]:
    return [f"*ELASTIC{_moduli(card)}", *_data([card.moduli["E"], card.others["nu"]])]


def _neo_hookean(card: Card) -> list[str]:
    """Neo-Hookean card with the constant C_10 = mu/2."""
    return _hyperelastic(card, "NEO HOOKE", [card.moduli["mu"] / 2.0], 1)


def _ogden(card: Card) -> list[str]:
    """Ogden card; for our W = sum (mu_i/alpha_i) (...) the coefficient is mu_i alpha_i/2.

    The exponents are the same in both.
    """
    pairs = list(zip(series(card.moduli, "mu"), series(card.others, "alpha"), strict=True))
    constants = [value for mu, alpha in pairs for value in (mu * alpha / 2.0, alpha)]
    return _hyperelastic(card, f"OGDEN, N={len(pairs)}", constants, len(pairs))


def _gent(card: Card) -> list[str]:
    r"""Gent card as the series of the Gent energy to order 6, C_k0 = mu/(2 k J^(k-1)).

    -(mu J/2) log(1 - x/J) = (mu/2) sum_k x^k/(k J^(k-1)), x = I_1 - 3. The stress of the first n
    terms is the Gent stress times 1 - (x/J)^n.
    """
    mu, limit = card.moduli["mu"], card.others["J"]
    constants = [mu / (2.0 * k * limit ** (k - 1)) for k in range(1, ORDER + 1)]
    law = f"REDUCED POLYNOMIAL, N={ORDER}"
    return _hyperelastic(card, law, constants, ORDER, _validity_of_series(card))


def _validity_of_series(card: Card) -> list[str]:
    """Comments on the stretch up to which the series' stress is within 1 % of the Gent stress."""
    limit = card.others["J"]
    reached = limit * CLOSE ** (1.0 / ORDER)
    biaxial, uniaxial = (_stretch(reached, power) for power in (2, 1))
    comments = [
        f"Abaqus has no Gent law. This card is a series of the Gent energy to order {ORDER}, with "
        f"J = {limit:.5g}. Its stress is too low, by less than 1 % up to stretch {biaxial:.4g} "
        f"equal-biaxial and {uniaxial:.4g} uniaxial, and by more beyond"
    ]
    if card.invariant is not None and card.invariant > reached:
        comments.append(
            f"NOTE: the specimen works beyond these stretches, at I_1 - 3 = {card.invariant:.4g}; "
            f"the series holds up to {reached:.4g}. Use a user subroutine (UHYPER) with Gent's law"
        )
    return comments


def _stretch(invariant: float, directions: int) -> float:
    """Return the stretch for I_1 - 3 in uniaxial (1 direction) or equal-biaxial (2) tension."""
    from scipy.optimize import brentq

    def excess(stretch: float) -> float:
        others = 2.0 / stretch if directions == 1 else stretch**-4.0
        return float(directions * stretch**2 + others - 3.0 - invariant)

    return float(brentq(excess, 1.0, (invariant + 3.0) ** 0.5))


ABAQUS = Program(
    name="Abaqus",
    mark=MARK,
    usage=("Abaqus: *INCLUDE this file in the model data, and name a material in *SOLID SECTION"),
    usage_of_relaxation=(
        "Relaxation acts in *VISCO and dynamic steps. A *STATIC step uses the solid before "
        "relaxation, and with its parameter LONG TERM the solid after it"
    ),
    opening=_opening,
    relaxation=_relaxation,
    laws={LINEAR: _linear, "gent": _gent, "neo_hookean": _neo_hookean, "ogden": _ogden},
)
