r"""The membrane's material, KV-GM about its pre-stretch, as a Gent solid that relaxes.

Shares are mu_beta_i/mu_total, right at small strain. At the pre-stretch lambda, relaxed, a sudden
small change of stretch changes the true stress lambda P by

(lambda P_alpha)' + sum_i 6 mu_beta_i/lambda   per stretch,

of which unit i bears 6 mu_beta_i/lambda: the linearised (12) of Nguyen et al. (2021). Programs
whose history integral is of true stress give it the share g_i there as everywhere: Abaqus, whose
stress of the past is turned by F^-1 tau F, which changes nothing where axes stay (Materials
Guide, time-domain viscoelasticity, finite strain).
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.systems.membrane_material import Material, gent_stress
from deabayes.systems.solid import FINITE_STRAIN, Note, Solid

TIMES = (
    "Relaxation times are tau_beta lambda^2/6 at the pre-stretch lambda = {stretch:.5g}, "
    "equal-biaxial, linearised; at other stretches the model's go with the square of the stretch"
)
SHARES = (
    "NOTE: shares are ratios of small-strain moduli, together {small:.4g}. Of a sudden small "
    "change of true stress at the pre-stretch the model's units bear {own:.4g} ({each}): for "
    "motions about the pre-stretch take these, with the long-term law as it is, in a program whose "
    "relaxation multiplies true stress, as that of Abaqus does"
)
DASHPOT = (
    "Dashpot alpha, zeta_alpha = {zeta:.5g} Pa s beside all springs, has no counterpart in a Prony "
    "series and is left out: it matters below about {time:.3g} s, zeta_alpha over the stiffness "
    "at {state} before the units relax"
)
LIMITS = (
    "The springs of the units have a limit of their own, J_beta = {beta:.5g}; the card scales one "
    "law, that of spring alpha with J_alpha = {alpha:.5g}"
)


def solid(material: Material, density: FloatArray | None) -> Solid:
    """Gent's law of spring alpha, and the units' relaxation at the pre-stretch."""
    stretch, total = material.prestretch, material.modulus + material.unit_moduli.sum(axis=1)
    square = stretch**2
    shares = material.unit_moduli / total[:, None]
    zeta = {"zeta": material.viscosity, "time": material.fastest}
    limits = {"beta": 1.0 / material.unit_inverse_limit, "alpha": 1.0 / material.inverse_limit}
    return Solid(
        "gent",
        {"mu": material.modulus},
        {"J": limits["alpha"]},
        False,
        shares,
        material.unit_times * square[:, None] / 6.0,
        density,
        np.asarray(2.0 * square + stretch**-4.0 - 3.0),
        (
            Note(FINITE_STRAIN),
            Note(TIMES, {"stretch": stretch}),
            _shares_there(material, shares.sum(axis=1)),
            Note(DASHPOT.replace("{state}", "the pre-stretch"), zeta),
            Note(LIMITS, limits),
        ),
    )


def shares_at_prestretch(material: Material) -> FloatArray:
    """The units' shares (W, n) of a sudden small change of true stress at the pre-stretch."""
    stretch = material.prestretch
    force, slope = gent_stress(stretch, material.inverse_limit)
    units = 6.0 * material.unit_moduli / stretch[:, None]
    spring = material.modulus * (force + stretch * slope)
    return np.asarray(units / (spring + units.sum(axis=1))[:, None])


def _shares_there(material: Material, small: FloatArray) -> Note:
    """The note on them, beside those of small strain."""
    own = shares_at_prestretch(material)
    each = {f"g_{i}": shares for i, shares in enumerate(own.T, start=1)}
    listed = ", ".join(f"{name} = {{{name}:.6g}}" for name in each)
    values = {"small": small, "own": own.sum(axis=1), **each}
    return Note(SHARES.replace("{each}", listed), values)
