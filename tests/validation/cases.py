"""The three data sets of mixing.md, on which samplers of the membrane are compared.

One simulated data set each, priors of `membrane_worlds.membrane`, fitted with three units:
A has relaxation times of 3, 30 and 250 s at the pre-stretch, P the paper's 6, 50 and 125 s,
B only two units (3 and 250 s). The noise is a sensor's: 2 um white, 3 um correlated over 2 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.inference.log_posterior import LogPosterior
from tests.validation.membrane_worlds import membrane
from tests.validation.worlds import NoiseGroups, given, responded

SEED = 20261124
RELAXATION_TIMES: Mapping[str, tuple[float, ...]] = {
    "A": (3.0, 30.0, 250.0),
    "B": (3.0, 250.0),
    "P": (6.0, 50.0, 125.0),
}
STIFFNESS = {
    "mu_alpha": 35e3, "zeta_alpha": 1e5, "J_alpha": 110.0, "J_beta": 55.0, "permittivity": 4.11e-11
}  # fmt: skip
UNIT_MODULUS = 15e3
NOISE = {"sigma_white": 2e-6, "sigma_ou": 3e-6, "tau_ou": 2.0}
LINEARISED = 9.0 / 6.0
"""Relaxation time at the pre-stretch over tau: lambda_p^2/6 (equations.md 2)."""


def case(name: str, noise_groups: NoiseGroups = "protocol") -> LogPosterior:
    """The posterior of three units given the data set of a case.

    Parameters
    ----------
    noise_groups : "protocol": one set of noise parameters, 14 in all; "experiment": one
        for each record as in mixing.md, 20 in all.
    """
    times = RELAXATION_TIMES[name]
    truth = dict(STIFFNESS)
    truth |= {f"mu_beta_{i}": UNIT_MODULUS for i in range(1, len(times) + 1)}
    truth |= {f"tau_beta_{i}": time / LINEARISED for i, time in enumerate(times, start=1)}
    world = replace(membrane(), noise_groups=noise_groups)
    source = world.target(len(times))
    rng = np.random.default_rng([SEED, *name.encode()])
    draws = {key: np.array([value]) for key, value in truth.items()}
    noise = {key: np.array([value]) for key, value in NOISE.items()}
    records = [responded(source, draws, noise, record, rng) for record in world.records]
    return given(world.target(3), records)
