"""Display of SI values: units with prefixes, symbols and digits."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

PREFIXED: Mapping[str, tuple[tuple[float, str], ...]] = {
    "Pa": ((1.0, "Pa"), (1e3, "kPa"), (1e6, "MPa"), (1e9, "GPa")),
    "s": ((1e-6, "µs"), (1e-3, "ms"), (1.0, "s")),
    "m": ((1e-6, "µm"), (1e-3, "mm"), (1.0, "m")),
    "m²": ((1e-6, "mm²"), (1.0, "m²")),
    "N": ((1e-6, "µN"), (1e-3, "mN"), (1.0, "N"), (1e3, "kN")),
    "V": ((1e-3, "mV"), (1.0, "V"), (1e3, "kV")),
    "A": ((1e-6, "µA"), (1e-3, "mA"), (1.0, "A")),
    "F": ((1e-12, "pF"), (1e-9, "nF"), (1e-6, "µF"), (1.0, "F")),
    "Ω": ((1.0, "Ω"), (1e3, "kΩ"), (1e6, "MΩ"), (1e9, "GΩ")),
    "Hz": ((1e-3, "mHz"), (1.0, "Hz"), (1e3, "kHz")),
    "kg": ((1e-6, "mg"), (1e-3, "g"), (1.0, "kg")),
    "1/Pa": ((1e-9, "1/GPa"), (1e-6, "1/MPa"), (1e-3, "1/kPa"), (1.0, "1/Pa")),
    "1/V": ((1e-6, "1/MV"), (1e-3, "1/kV"), (1.0, "1/V")),
}
COMPOUND_HEADS = ("Pa", "N", "Ω", "F")
DIMENSIONLESS = {"", "1", "-", "none", "dimensionless"}
PERCENT_QUANTITIES = ("strain",)
ROLES = {"calibrate": "calibration", "validate": "held out"}
GREEK_NAMES = (
    "alpha beta gamma delta epsilon varepsilon zeta eta theta kappa lambda mu nu xi rho sigma tau "
    "phi varphi chi psi omega Delta Sigma Phi Omega"
).split()
GREEK = dict(zip(GREEK_NAMES, "αβγδεεζηθκλμνξρστφφχψωΔΣΦΩ", strict=True))
SIGNS = {"infty": "∞", "cdot": "·", "times": "×", "sum": "Σ", "ell": "ℓ", "prime": "′", "dot": ""}
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True)
class DisplayUnit:
    """SI value / `factor` is the number shown before `label` (empty for a plain number)."""

    factor: float
    label: str

    @property
    def suffix(self) -> str:
        """`` (kPa)`` for an axis label, empty for a plain number."""
        return f" ({self.label})" if self.label else ""

    @property
    def behind(self) -> str:
        """`` kPa`` behind a number, empty for a plain one."""
        return f" {self.label}" if self.label else ""


def display_unit(unit: str, values: ArrayLike, name: str = "") -> DisplayUnit:
    """The unit in which `values` (SI) read well: 35000 Pa as kPa, 0.006 s as ms.

    Parameters
    ----------
    unit : SI unit in pint's notation.
    values : any shape; their largest finite magnitude decides.
    name : name of the quantity, since some are usually given in percent.
    """
    magnitudes = np.abs(np.asarray(values, dtype=float))
    finite = magnitudes[np.isfinite(magnitudes)]
    magnitude = float(finite.max(initial=0.0)) or 1.0
    if unit == "rad":
        return DisplayUnit(np.pi / 180.0, "°")
    if name == "gain":
        return DisplayUnit(0.01, "%/V")
    if unit in DIMENSIONLESS:
        return DisplayUnit(0.01, "%") if name in PERCENT_QUANTITIES else DisplayUnit(1.0, "")
    pretty = pretty_unit(unit)
    if pretty in PREFIXED:
        return DisplayUnit(*_prefix(pretty, magnitude))
    head = re.match(r"[A-Za-zΩ]+", pretty)
    if head and head[0] in COMPOUND_HEADS:
        factor, label = _prefix(head[0], magnitude)
        return DisplayUnit(factor, label + pretty[head.end() :])
    return DisplayUnit(1.0, pretty)


def with_unit(value: float, unit: str, name: str = "", digits: int = 6) -> str:
    """A value in SI with its display unit, for sentences: ``80 µm`` for 8e-05 m."""
    shown = display_unit(unit, value, name)
    return f"{value / shown.factor:.{digits}g}{shown.behind}"


def taken_in_si(value: object, unit: str, where: str) -> str:
    """The caution that a number without a unit is taken in SI."""
    taken = f"{value} {unit}"
    return f"{where}: {value} without a unit is {taken}; write '{taken}' if that is meant"


def _prefix(unit: str, magnitude: float) -> tuple[float, str]:
    choices = [choice for choice in PREFIXED[unit] if choice[0] <= 1.0001 * magnitude]
    return choices[-1] if choices else PREFIXED[unit][0]


def pretty_unit(unit: str) -> str:
    """pint's notation in print: ``N*s/m`` -> ``N·s/m``, ``m**2`` -> ``m²``, ``ohm`` -> ``Ω``."""
    text = re.sub(r"(?:\*\*|\^)(-?\d+)", lambda m: m[1].translate(SUPERSCRIPTS), unit.strip())
    text = re.sub(r"\s*\*\s*|\s+(?=[A-Za-z])", "·", text)
    return re.sub(r"\s*/\s*", "/", text).replace("ohm", "Ω").replace("/·", "/")


SKEWED = 0.3
"""Share of an interval's half width below which a number would lose its digits by rounding."""


def round_to(value: float, step: float) -> str:
    """`value` rounded to the two leading digits of `step`, without needless zeros or exponents."""
    if not math.isfinite(value):
        return "–"
    if not (math.isfinite(step) and step > 0):
        step = abs(value) / 10 or 1.0
    decimals = 1 - math.floor(math.log10(step))
    largest = abs(value)
    if decimals > 6 or largest >= 1e6:
        return scientific(value)
    return fixed(value, decimals)


def fixed(value: float, decimals: int) -> str:
    """`value` to so many decimals (negative: tens, hundreds); a zero has no sign."""
    rounded = round(value, decimals) + 0.0
    return f"{rounded:.{max(decimals, 0)}f}".replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """`value` to `digits` significant digits."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -4 <= exponent < 6:
        return scientific(value, digits)
    return fixed(value, digits - 1 - exponent)


def short(value: float, digits: int = 3) -> str:
    """`value` to at most `digits` significant digits, trailing zeros dropped."""
    text = significant(value, digits)
    if "." not in text or "×" in text:
        return text
    return text.rstrip("0").rstrip(".")


def scientific(value: float, digits: int = 3) -> str:
    """``1.23×10⁹``."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}×10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", "−")


def interval(median: float, low: float, high: float) -> str:
    """``35.2 [33.9, 36.6]``, rounded to what the interval's width supports.

    If this would remove all digits of the smallest number, and all numbers have one sign, each
    number gets two significant digits: ``570 [150, 7200]``.
    """
    step = (high - low) / 2
    numbers = (median, low, high)
    if min(numbers) * max(numbers) > 0.0 and min(map(abs, numbers)) < SKEWED * step:
        return f"{short(median, 2)} [{short(low, 2)}, {short(high, 2)}]"
    return f"{round_to(median, step)} [{round_to(low, step)}, {round_to(high, step)}]"


def symbol_text(name: str, symbol: str) -> str:
    """A parameter's symbol for matplotlib, with its noise group in front where it has one."""
    group = name.rpartition(".")[0]
    text = f"${symbol.strip('$')}$" if symbol else plain(name.rpartition(".")[2])
    return f"{plain(group)}: {text}" if group else text


def symbol_html(symbol: str) -> str:
    """A mathtext symbol as HTML: ``\\mu_\\alpha`` -> ``μ<sub>α</sub>``."""
    text = html.escape(symbol.strip("$"))
    text = re.sub(r"\\(?:mathrm|text|mathit|rm|mathregular)\s*(?=\{)", "", text)
    text = re.sub(r"\\([A-Za-z]+)\s?", lambda m: (GREEK | SIGNS).get(m[1], m[1]), text)
    text = re.sub(r"\\[,;!: ]", " ", text)
    for mark, tag in (("_", "sub"), ("^", "sup")):
        text = re.sub(rf"\{mark}\{{((?:[^{{}}]|\{{[^{{}}]*\}})*)\}}", rf"<{tag}>\1</{tag}>", text)
        text = re.sub(rf"\{mark}(\S)", rf"<{tag}>\1</{tag}>", text)
    return text.replace("{", "").replace("}", "")


def plain(name: str) -> str:
    """A name without underscores: ``nominal_stress`` -> ``nominal stress``."""
    return name.replace("_", " ")
