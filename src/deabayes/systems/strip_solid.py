"""The tensile strip's material: its spring, relaxing as its units do at small strain."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.systems.base import Draws
from deabayes.systems.membrane_solid import DASHPOT, LIMITS
from deabayes.systems.solid import FINITE_STRAIN, Note, Solid, coefficients, no_relaxation
from deabayes.systems.strip_candidates import StripModel

TIMES = (
    "Relaxation times are tau/3, those in uniaxial tension at stretch 1, linearised; at other "
    "stretches the model's go with the square of the stretch"
)
NEO_HOOKEAN_UNITS = (
    "Springs of the units are neo-Hookean, the spring beside them is not ({law}); the card scales "
    "one law, that spring's"
)
ELASTIC = "The candidate has no relaxation units: the card is elastic, and knows no time"


def solid(model: StripModel, draws: Draws) -> Solid:
    """The law of the spring beside the units, and their relaxation at stretch 1."""
    spring = model.spring_draws(draws)
    moduli, others = coefficients(model.spring.parameters(model.terms), spring)
    long_term = np.asarray(model.spring.shear_modulus(spring), dtype=float)
    if model.units == 0:
        none = no_relaxation(long_term)
        return Solid(model.spring.name, moduli, others, False, none, none, notes=(Note(ELASTIC),))
    unit_moduli, times = (values.T for values in model.unit_draws(draws))
    total = long_term + unit_moduli.sum(axis=1)
    return Solid(
        model.spring.name,
        moduli,
        others,
        False,
        unit_moduli / total[:, None],
        times / 3.0,
        notes=(Note(FINITE_STRAIN), Note(TIMES), *_of_model(model, draws, total)),
    )


def _of_model(model: StripModel, draws: Draws, total: FloatArray) -> tuple[Note, ...]:
    """What differs between the candidate's springs, and its dashpot alpha."""
    if model.kelvin:
        zeta = np.asarray(draws["zeta_alpha"], dtype=float)
        limits = {"beta": draws["J_beta"], "alpha": draws["J_alpha"]}
        dashpot = DASHPOT.replace("{state}", "stretch 1")
        return Note(dashpot, {"zeta": zeta, "time": zeta / (3.0 * total)}), Note(LIMITS, limits)
    if model.spring.name == "neo_hookean":
        return ()
    return (Note(NEO_HOOKEAN_UNITS.format(law=model.spring.name)),)
