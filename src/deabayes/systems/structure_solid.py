"""The film of a minimum-energy structure as a solid: its spring, which is what carries at rest."""

from __future__ import annotations

import numpy as np

from deabayes.systems.solid import Note, Solid, coefficients, no_relaxation
from deabayes.systems.structure_static import Structure

STRETCHES = (
    "Stretches count from the film before its pre-stretch: at rest they are {along:.5g} along and "
    "{across:.5g} across the structure"
)
LONG_TERM = "The law is that of rest, long-term: the card is elastic"
UNITS = (
    "Maxwell units act along the slider and are no material: they and the friction follow as "
    "comments, to be put as springs and dashpots between the structure's ends"
)
UNIT = "Unit {i}: k_{i} = {{k:.6g}} N/m, tau_{i} = {{tau:.6g}} s, in series"
FRICTION = {
    False: ("eta_0", "Viscous friction at the slider: eta_0 = {friction:.6g} N s/m"),
    True: ("friction_force", "Dry friction at the slider: F_c = {friction:.6g} N"),
}


def solid(structure: Structure) -> Solid:
    """The film's long-term law; its units and friction are told in notes."""
    model, draws = structure.model, structure.draws
    moduli, others = coefficients(model.spring.parameters(model.terms), draws)
    along, across = structure.prestretch * np.cos(structure.rest), structure.prestretch
    none = no_relaxation(along)
    return Solid(
        model.spring.name,
        moduli,
        others,
        False,
        none,
        none,
        None,
        np.asarray(along**2 + across**2 + (along * across) ** -2.0 - 3.0),
        (
            Note(LONG_TERM),
            Note(STRETCHES, {"along": along, "across": across}),
            *_along_the_slider(structure),
        ),
    )


def _along_the_slider(structure: Structure) -> tuple[Note, ...]:
    model = structure.model
    if model.units == 0:
        return ()
    stiffness, times = model.unit_draws(structure.draws)
    name, friction = FRICTION[model.dry]
    return (
        Note(UNITS),
        *(
            Note(UNIT.format(i=i), {"k": stiffness[:, i - 1], "tau": times[:, i - 1]})
            for i in model.numbers
        ),
        Note(friction, {"friction": structure.draws[name]}),
    )
