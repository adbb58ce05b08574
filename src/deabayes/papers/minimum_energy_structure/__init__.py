"""Values of the paper on the minimum-energy structure (2019) that survive in its text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.papers.timing import amplitude, near
from deabayes.systems.base import System

NAME = "paper"
FILM = {
    "mu_1": 73.98e3, "mu_2": 634.06e3, "mu_3": 127.92e3, "mu_4": 3.45e3,
    "alpha_1": 0.243, "alpha_2": 0.331, "alpha_3": 0.744, "alpha_4": 3.306,
    "relative_permittivity": 1.704,
}  # fmt: skip
"""Table 3, SI, in ascending order of the exponents: the paper's third term comes first."""
TERMS = 4
FORCE_ERROR = 6.0
"""Largest error of the force [%] at all voltages; the paper does not say relative to what."""
GA_BOUNDS = {"mu": (1e3, 1e6), "alpha": (0.0, 5.0), "relative_permittivity": (0.0, 5.0)}
"""Bounds of the genetic algorithm, (25), SI."""
GA_POPULATION, GA_GENERATIONS = 100, 1000
STIFFNESS, VISCOSITY = (66.0, 8.0, 3.5, 0.8), (0.55, 4.0, 20.0, 50.0)
"""Table 4: k_i [N/m] and xi_i [N s/m], fastest unit first."""
ETA_0 = 0.1
"""Friction eta_0 [N s/m]; the paper calls it a Coulomb coefficient."""
E_RMS: Mapping[float, tuple[float, ...]] = {
    5.0: (6.14, 5.85, 5.10, 4.50, 3.88, 3.78, 5.30, 6.22, 6.39, 7.37),
    4.0: (8.67, 7.62, 7.36, 7.74, 7.02, 7.25, 8.45, 8.52, 9.06, 10.78),
}
"""Table 5: e_rms [%] at 1, 2, ..., 10 Hz, by voltage [kV]."""
SHOWN = (1.0, 5.0, 10.0)
"""Frequencies [Hz] of the records in Figs 4(D), 8 and 10."""


def film_of(specimen: Specimen) -> tuple[System, dict[str, FloatArray]]:
    """Film of the paper's Table 3 in a specimen: its system, and its parameters as one draw."""
    from deabayes.systems import build

    draws = {name: np.array([value]) for name, value in FILM.items()}
    return build(specimen.system, f"ogden_{TERMS}", specimen), draws


def count_of(symbol: str, names: Iterable[str]) -> int:
    """Number of parameters `{symbol}_1`, `{symbol}_2`, ... among these names."""
    return sum(name.startswith(f"{symbol}_") for name in names)


def e_rms(kilovolts: float, hertz: float) -> float:
    """Entry of Table 5 for a sine; NaN if the table has none or `hertz` is not finite."""
    for voltage, row in E_RMS.items():
        for printed, value in enumerate(row, start=1):
            if near(kilovolts, voltage) and near(hertz, printed):
                return value
    return float("nan")


def kilovolts(experiment: Experiment) -> float:
    """Highest voltage of a sine, or constant voltage of a force record [kV]."""
    driven = experiment.excitation
    volts = amplitude(driven) if driven.name == "voltage" else float(driven.conditions["voltage"])
    return volts / 1e3
