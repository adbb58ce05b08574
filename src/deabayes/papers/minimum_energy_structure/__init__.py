"""Values of the paper on the minimum-energy structure (2019) that survive in its text."""

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


def e_rms(kilovolts: float, hertz: float) -> float:
    """Entry of Table 5 for a sine; NaN if the table has none or `hertz` is not finite."""
    if not math.isfinite(hertz):
        return float("nan")
    for voltage, row in E_RMS.items():
        nearest = round(hertz)
        if near(kilovolts, voltage) and near(hertz, nearest) and 1 <= nearest <= len(row):
            return row[nearest - 1]
    return float("nan")


def near(value: float, printed: float, tolerance: float = 0.02) -> bool:
    """Whether a record's voltage or frequency equals a printed value within `tolerance`."""
    return abs(value - printed) <= tolerance * printed


def kilovolts(experiment: Experiment) -> float:
    """Highest voltage of a sine, or constant voltage of a force record [kV]."""
    driven = experiment.excitation
    if driven.name == "voltage":
        return float(abs(driven.values).max()) / 1e3
    return float(driven.conditions["voltage"]) / 1e3
