"""The models of NIST's nonlinear regression sets, as functions of x and the parameters b.

Every model takes x (N,) and parameters that broadcast with it, (W, 1) for W draws, and gives
(W, N). The equations are NIST's (Statistical Reference Datasets, nonlinear regression).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from deabayes.experiment import FloatArray

Model = Callable[..., FloatArray]


@dataclass(frozen=True)
class Curve:
    """A model, and which of its parameters can be exchanged or flipped without any effect.

    Attributes
    ----------
    linear : parameters in which the response is linear, without a constant; named for sets whose
        posterior is too thin and bent to be weighed up in all parameters (`nist_reference`).
    lower : parameter -> the lowest value that makes sense: 0 where the response is even in it,
        two spacings of x for a period (a shorter one is the alias of a longer).
    scaled : parameter -> the one of the same kind whose starting value tells its size too (of a
        cosine and a sine of one period, the larger).
    ordered : parameters whose terms can be exchanged, in ascending order of their estimates.
    belonging : parameter -> the ordered one in whose term it is.
    """

    model: Model
    linear: tuple[str, ...] = ()
    lower: Mapping[str, float] = field(default_factory=dict)
    scaled: Mapping[str, str] = field(default_factory=dict)
    ordered: tuple[str, ...] = ()
    belonging: Mapping[str, str] = field(default_factory=dict)


def exponentials(x: FloatArray, *b: FloatArray) -> FloatArray:
    """b1 exp(-b2 x) + b3 exp(-b4 x) + ..."""
    terms = (a * np.exp(-rate * x) for a, rate in zip(b[::2], b[1::2], strict=True))
    return np.sum(np.stack(list(terms)), axis=0)


def two_peaks(x: FloatArray, b1: FloatArray, b2: FloatArray, *peaks: FloatArray) -> FloatArray:
    """A decay with two Gaussian peaks, each by height, centre and width."""
    total = b1 * np.exp(-b2 * x)
    for height, centre, width in (peaks[:3], peaks[3:]):
        total = total + height * np.exp(-(((x - centre) / width) ** 2))
    return total


def rational(x: FloatArray, *b: FloatArray) -> FloatArray:
    """A ratio of two polynomials of one degree; the constant of the denominator is 1."""
    degree = len(b) // 2
    above = sum(b[k] * x**k for k in range(degree + 1))
    below = 1.0 + sum(b[degree + k] * x**k for k in range(1, degree + 1))
    return np.asarray(above / below)


def enso(
    x: FloatArray, b1: FloatArray, b2: FloatArray, b3: FloatArray, *cycles: FloatArray
) -> FloatArray:
    """A year's cycle of 12 months and two more, each by period, cosine and sine."""
    total = b1
    for period, cosine, sine in ((12.0, b2, b3), cycles[:3], cycles[3:]):
        angle = 2.0 * np.pi * x / period
        total = total + cosine * np.cos(angle) + sine * np.sin(angle)
    return total


SATURATING = Curve(lambda x, b1, b2: -b1 * np.expm1(-b2 * x))
CHWIRUT = Curve(lambda x, b1, b2, b3: np.exp(-b1 * x) / (b2 + b3 * x))
LANCZOS = Curve(
    exponentials,
    ("b1", "b3", "b5"),
    ordered=("b2", "b4", "b6"),
    belonging={"b1": "b2", "b3": "b4", "b5": "b6"},
)
GAUSS = Curve(
    two_peaks,
    lower={"b5": 0.0, "b8": 0.0},
    ordered=("b4", "b7"),
    belonging={"b3": "b4", "b5": "b4", "b6": "b7", "b8": "b7"},
)
CURVES: dict[str, Curve] = {
    "Misra1a": SATURATING,
    "Misra1b": Curve(lambda x, b1, b2: b1 * (1.0 - (1.0 + 0.5 * b2 * x) ** -2)),
    "Misra1c": Curve(lambda x, b1, b2: b1 * (1.0 - (1.0 + 2.0 * b2 * x) ** -0.5)),
    "Misra1d": Curve(lambda x, b1, b2: b1 * b2 * x / (1.0 + b2 * x)),
    "Chwirut1": CHWIRUT,
    "Chwirut2": CHWIRUT,
    "DanWood": Curve(lambda x, b1, b2: b1 * x**b2),
    **dict.fromkeys(("Lanczos1", "Lanczos2", "Lanczos3"), LANCZOS),
    **dict.fromkeys(("Gauss1", "Gauss2", "Gauss3"), GAUSS),
    "Kirby2": Curve(rational),
    "Hahn1": Curve(rational),
    "Thurber": Curve(rational),
    "MGH09": Curve(lambda x, b1, b2, b3, b4: b1 * x * (x + b2) / (x * (x + b3) + b4)),
    "MGH10": Curve(lambda x, b1, b2, b3: b1 * np.exp(b2 / (x + b3)), ("b1",)),
    "MGH17": Curve(
        lambda x, b1, b2, b3, b4, b5: b1 + exponentials(x, b2, b4, b3, b5),
        ("b1", "b2", "b3"),
        ordered=("b4", "b5"),
        belonging={"b2": "b4", "b3": "b5"},
    ),
    "Roszman1": Curve(lambda x, b1, b2, b3, b4: b1 - b2 * x - np.arctan(b3 / (x - b4)) / np.pi),
    "ENSO": Curve(
        enso,
        ("b1", "b2", "b3", "b5", "b6", "b8", "b9"),
        lower={"b4": 2.0, "b7": 2.0},
        scaled={"b3": "b2", "b6": "b5", "b8": "b9"},
        ordered=("b7", "b4"),
        belonging={"b5": "b4", "b6": "b4", "b8": "b7", "b9": "b7"},
    ),
    "BoxBOD": SATURATING,
    "Rat42": Curve(lambda x, b1, b2, b3: b1 / (1.0 + np.exp(b2 - b3 * x))),
    "Rat43": Curve(
        lambda x, b1, b2, b3, b4: b1 / (1.0 + np.exp(b2 - b3 * x)) ** (1.0 / b4), ("b1",)
    ),
    "Eckerle4": Curve(
        lambda x, b1, b2, b3: b1 / b2 * np.exp(-0.5 * ((x - b3) / b2) ** 2), lower={"b2": 0.0}
    ),
    "Bennett5": Curve(lambda x, b1, b2, b3: b1 * (b2 + x) ** (-1.0 / b3), ("b1",)),
}
"""All sets of one predictor. Nelson has two, and its response is a logarithm: left out."""
