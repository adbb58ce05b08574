"""What the paper on the minimum-energy structure (2019) prints, where it survives in the text."""

from __future__ import annotations

import math
from collections.abc import Mapping

from deabayes.experiment import Experiment

NAME = "paper"
FILM = {
    "mu_1": 73.98e3, "mu_2": 634.06e3, "mu_3": 127.92e3, "mu_4": 3.45e3,
    "alpha_1": 0.243, "alpha_2": 0.331, "alpha_3": 0.744, "alpha_4": 3.306,
    "relative_permittivity": 1.704,
}  # fmt: skip
"""Table 3, SI, exponents ascending: the third of the paper first."""
TERMS = 4
FORCE_ERROR = 6.0
"""Largest error of the force [%], all voltages, of what is not said."""
GA_BOUNDS = {"mu": (1e3, 1e6), "alpha": (0.0, 5.0), "relative_permittivity": (0.0, 5.0)}
"""(25), SI."""
GA_POPULATION, GA_GENERATIONS = 100, 1000
STIFFNESS, VISCOSITY = (66.0, 8.0, 3.5, 0.8), (0.55, 4.0, 20.0, 50.0)
"""Table 4: k_i [N/m] and xi_i [N s/m], fastest unit first."""
ETA_0 = 0.1
"""[N s/m]; the paper calls it a Coulomb coefficient."""
E_RMS: Mapping[float, tuple[float, ...]] = {
    5.0: (6.14, 5.85, 5.10, 4.50, 3.88, 3.78, 5.30, 6.22, 6.39, 7.37),
    4.0: (8.67, 7.62, 7.36, 7.74, 7.02, 7.25, 8.45, 8.52, 9.06, 10.78),
}
"""Table 5: voltage [kV] -> e_rms [%] at 1, 2, ..., 10 Hz."""
SHOWN = (1.0, 5.0, 10.0)
"""[Hz] of the records in Figs 4(D), 8 and 10."""


def e_rms(kilovolts: float, hertz: float) -> float:
    """The entry of Table 5 for a sine, NaN where it has none, as without a frequency."""
    if not math.isfinite(hertz):
        return float("nan")
    for voltage, row in E_RMS.items():
        nearest = round(hertz)
        if near(kilovolts, voltage) and near(hertz, nearest) and 1 <= nearest <= len(row):
            return row[nearest - 1]
    return float("nan")


def near(value: float, printed: float, tolerance: float = 0.02) -> bool:
    """Whether a record's voltage or frequency is that of a printed figure."""
    return abs(value - printed) <= tolerance * printed


def kilovolts(experiment: Experiment) -> float:
    """Highest voltage of a sine, constant one of a force record [kV]."""
    driven = experiment.excitation
    if driven.name == "voltage":
        return float(abs(driven.values).max()) / 1e3
    return float(driven.conditions["voltage"]) / 1e3
