r"""Material cards of Abaqus.

The energies in Abaqus, with deviatoric stretches l_i and the first invariant I_1 of them:

OGDEN               U = sum_i (2 mu_i/alpha_i^2) (l_1^alpha_i + l_2^alpha_i + l_3^alpha_i - 3)
REDUCED POLYNOMIAL  U = sum_k C_k0 (I_1 - 3)^k

plus volumetric terms with D_i; D_i = 0 is incompressible. Relaxation is
g(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)), data lines g_i, k_i, tau_i (Abaqus Keywords Guide,
*HYPERELASTIC, *VISCOELASTIC; Materials Guide, hyperelasticity and time-domain viscoelasticity).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr

from deabayes.export.cards import Card, Lines, Program, commented, series, write_cards, written
from deabayes.systems.solid import LINEAR

MARK = "**"
ORDER = 6
PER_LINE = 8
CLOSE = 0.01
SAID = ("Abaqus: *INCLUDE this file among the model data and name a material in *SOLID SECTION",)
OF_RELAXATION = (
    "Relaxation acts in *VISCO and dynamic steps; a *STATIC step takes the solid before relaxation "
    "(with its parameter LONG TERM, that after it)",
)
INCOMPRESSIBLE = (
    "D_i = 0: incompressible. Abaqus/Standard needs hybrid elements (C3D8H, CPE4H, ...) for it "
    "unless stress is plane; Abaqus/Explicit does not take it: give D_1 = 2/bulk modulus",
)


def write(tree: xr.DataTree, path: Path, *, draws: int | None = None) -> None:
    """Write cards for `*INCLUDE`, with one `*MATERIAL` per card.

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
    lines = [f"*MATERIAL, NAME={card.name}"]
    if card.density is not None:
        lines += ["*DENSITY", f"{card.density:.9g},"]
    lines += written(card.law, LAWS, "Abaqus")(card)
    if card.shares:
        lines.append("*VISCOELASTIC, TIME=PRONY")
        lines += [f"{g:.9g}, 0., {tau:.9g}" for g, tau in zip(card.shares, card.times, strict=True)]
    return lines


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


def _linear(card: Card) -> list[str]:
    return [f"*ELASTIC{_moduli(card)}", *_data([card.moduli["E"], card.others["nu"]])]


def _neo_hookean(card: Card) -> list[str]:
    """Neo-Hookean card with the constants C_10 = mu/2 and D_1."""
    return [
        *commented(INCOMPRESSIBLE, MARK),
        f"*HYPERELASTIC, NEO HOOKE{_moduli(card)}",
        *_data([card.moduli["mu"] / 2.0, 0.0]),
    ]


def _ogden(card: Card) -> list[str]:
    """Ogden card; for our W = sum (mu_i/alpha_i) (...) the coefficient is mu_i alpha_i/2.

    The exponents are the same in both.
    """
    pairs = zip(series(card.moduli, "mu"), series(card.others, "alpha"), strict=True)
    data = [value for mu, alpha in pairs for value in (mu * alpha / 2.0, alpha)]
    terms = len(data) // 2
    return [
        *commented(INCOMPRESSIBLE, MARK),
        f"*HYPERELASTIC, OGDEN, N={terms}{_moduli(card)}",
        *_data([*data, *[0.0] * terms]),
    ]


def _gent(card: Card) -> list[str]:
    r"""Gent card as the series of the Gent energy to order 6, C_k0 = mu/(2 k J^(k-1)).

    -(mu J/2) log(1 - x/J) = (mu/2) sum_k x^k/(k J^(k-1)), x = I_1 - 3. The stress of the first n
    terms is the Gent stress times 1 - (x/J)^n.
    """
    mu, limit = card.moduli["mu"], card.others["J"]
    data = [mu / (2.0 * k * limit ** (k - 1)) for k in range(1, ORDER + 1)]
    return [
        *commented([*_series_holds(card), *INCOMPRESSIBLE], MARK),
        f"*HYPERELASTIC, REDUCED POLYNOMIAL, N={ORDER}{_moduli(card)}",
        *_data([*data, *[0.0] * ORDER]),
    ]


def _series_holds(card: Card) -> list[str]:
    """Comments on the stretch up to which the series' stress is within 1 % of the Gent stress."""
    limit = card.others["J"]
    reached = limit * CLOSE ** (1.0 / ORDER)
    biaxial, uniaxial = (_stretch(reached, power) for power in (2, 1))
    said = [
        f"Abaqus has no Gent law: this is the series of its energy to order {ORDER}, with J = "
        f"{limit:.5g}. Its stress stays within 1 % of the Gent spring's up to stretch "
        f"{biaxial:.4g} equal-biaxial and {uniaxial:.4g} uniaxial, and is too low beyond"
    ]
    if card.invariant is not None and card.invariant > reached:
        said.append(
            f"NOTE: the specimen itself is beyond that, at I_1 - 3 = {card.invariant:.4g} "
            f"(the series holds up to {reached:.4g}): use a user subroutine (UHYPER) with Gent's "
            "law"
        )
    return said


def _stretch(invariant: float, directions: int) -> float:
    """Return the stretch for I_1 - 3 in uniaxial (1 direction) or equal-biaxial (2) tension."""
    from scipy.optimize import brentq

    def excess(stretch: float) -> float:
        others = 2.0 / stretch if directions == 1 else stretch**-4.0
        return float(directions * stretch**2 + others - 3.0 - invariant)

    return float(brentq(excess, 1.0, (invariant + 3.0) ** 0.5))


LAWS: Mapping[str, Lines] = {
    LINEAR: _linear,
    "gent": _gent,
    "neo_hookean": _neo_hookean,
    "ogden": _ogden,
}
