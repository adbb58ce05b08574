"""The film of the minimum-energy structure: derived quantities, and the film as a solid."""

from __future__ import annotations

import numpy as np

from deabayes.systems.base import Derived
from deabayes.systems.minimum_energy_structure.static import Structure
from deabayes.systems.solid import Note, Solid, coefficients, no_relaxation
from deabayes.systems.specimen_quantities import positive


def derived(structure: Structure, voltage: float) -> dict[str, Derived]:
    """Return mu_0, K, snap voltage, force and displacement at `voltage` [V], and f_0, xi_i."""
    kilovolts = f"{voltage / 1e3:g}kV"
    _, square = structure.branch
    end = np.sqrt(square[:, -1])
    rest, length = structure.rest, 2.0 * structure.length
    blocking = structure.electric * np.cos(rest) * voltage**2 / length
    free = length * (np.cos(structure.equilibrium(voltage)) - np.cos(rest))
    found = {
        "mu_0": Derived(
            r"\mu_0", "Pa", "small-strain shear modulus of the film",
            np.asarray(structure.model.spring.shear_modulus(structure.draws)),
        ),
        "hinge_stiffness": Derived(
            "K", "N*m/rad", "stiffness of a hinge, from equilibrium at the rest angle",
            structure.hinge / 4.0,
        ),
        "snap_voltage": Derived(
            r"U_\mathrm{max}", "V", "voltage at which the bent branch ends, at 3 degrees or the "
            "film's lock-up at last",
            end,
        ),
        f"blocking_force_{kilovolts}": Derived(
            rf"F({voltage / 1e3:g}\,\mathrm{{kV}})", "N", "force on a slider held at rest", blocking
        ),
        f"free_displacement_{kilovolts}": Derived(
            rf"d({voltage / 1e3:g}\,\mathrm{{kV}})", "m",
            "displacement at rest of a free slider; that at the end of the bent branch where the "
            "voltage is beyond it",
            np.where(end >= voltage, free, _last_displacement(structure)),
        ),
    }  # fmt: skip
    return found if structure.model.units == 0 else {**found, **_in_motion(structure)}


def _last_displacement(structure: Structure) -> np.ndarray:
    angle, _ = structure.branch
    return 2.0 * structure.length * (np.cos(angle[:, -1]) - np.cos(structure.rest))


def _in_motion(structure: Structure) -> dict[str, Derived]:
    stiffness, times = structure.model.unit_draws(structure.draws)
    rest = structure.rest
    lever = 2.0 * structure.length * np.sin(rest)
    stiff = structure.stiffness(rest) + lever**2 * stiffness.sum(axis=1)
    found = {
        "natural_frequency": Derived(
            "f_0", "Hz",
            "natural frequency of small oscillations about rest, without damping, the units stiff",
            np.sqrt(positive(stiff) / structure.mass(rest)) / (2.0 * np.pi),
        )
    }  # fmt: skip
    for i in range(1, structure.model.units + 1):
        found[f"xi_{i}"] = Derived(
            rf"\xi_{i}", "N s/m", f"viscosity of unit {i}, k tau",
            stiffness[:, i - 1] * times[:, i - 1],
        )  # fmt: skip
    return found


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
    """Return the film's long-term law as a solid; notes describe the units and the friction."""
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
            for i in range(1, model.units + 1)
        ),
        Note(friction, {"friction": structure.draws[name]}),
    )
