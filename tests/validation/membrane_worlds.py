"""The membrane of the recovery and order checks, with priors about its paper's parameters.

The priors are the default ones narrowed about the parameters of Nguyen et al. (2021), so that
over nine in ten draws stay on the near branch at 4 kV. A draw that is pulled in is drawn
again: the posterior excludes it too (its likelihood is zero), so ranks stay uniform. Records
are those of the joint fit in mixing.md: steps to 2, 3 and 4 kV with 155 points each on a grid
whose spacing doubles from 0.25 to 8 s, to 595 s. Held out are a step to 3.5 kV and five
periods of a sine of 2 kV at 0.05 Hz.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Quantity, Role, Specimen
from deabayes.study import Settings
from tests.validation.worlds import World, blank


def doubling_grid(points: int = 20, last: int = 55, refined: int = 1) -> FloatArray:
    """Times whose spacing doubles from 0.25 to 8 s: 155 points to 595 s, or `refined` as many."""
    counts = [points] * 5 + [last]
    spacing = np.concatenate([np.full(n, 0.25 * 2**k) for k, n in enumerate(counts)])
    return np.cumsum(np.repeat(spacing / refined, refined))


def membrane(refined: int = 1) -> World:
    """The membrane; `refined` sets how many times denser than 155 points its records are."""
    quantities = {
        "side_length": Quantity(0.01, "m"),
        "thickness": Quantity(1e-3, "m"),
        "permittivity": Quantity(4.11e-11, "F/m", 0.9e-12),
        "prestretch": Quantity(3.0, "1"),
    }
    grid, displacement = doubling_grid(refined=refined), ("displacement", "m")

    def step(kilovolts: float, role: Role = "calibrate") -> Experiment:
        volts = np.full(2, 1e3 * kilovolts)
        excitation = Excitation("voltage", "V", np.array([0.0, 600.0]), volts)
        return blank(f"step_{kilovolts:g}kV", "step", displacement, grid, excitation, role)

    knots = np.linspace(0.0, 100.0, 2001)
    alternating = Excitation("voltage", "V", knots, 2e3 * np.sin(0.1 * np.pi * knots))
    sine = blank("sine_2kV", "sine", displacement, knots[10::10], alternating, "validate")
    return World(
        "kv_gm",
        Specimen("validation", "membrane", {"kind": "simulated"}, quantities),
        membrane_priors,
        (step(2.0), step(3.0), step(4.0)),
        (step(3.5, "validate"), sine),
    )


def membrane_priors(units: int) -> dict[str, Settings]:
    """The default priors, narrowed about Nguyen et al. (2021)."""
    return {
        "mu_alpha": {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.3},
        "zeta_alpha": {"distribution": "lognormal", "median": "100 kPa s", "sigma": 0.7},
        "J_alpha": {"distribution": "lognormal", "median": 110.0, "sigma": 0.4},
        "J_beta": {"distribution": "lognormal", "median": 55.0, "sigma": 0.4},
        "tau_beta": {"distribution": "loguniform", "lower": "2 s", "upper": "400 s"},
        **{
            f"mu_beta_{i}": {"distribution": "lognormal", "median": "15 kPa", "sigma": 0.6}
            for i in range(1, units + 1)
        },
    }
