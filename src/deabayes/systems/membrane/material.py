"""Constants of the membrane for every draw, and its material as a Gent solid that relaxes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Specimen
from deabayes.integrate.drive import Drive
from deabayes.systems.base import Derived, Draws
from deabayes.systems.membrane.candidates import MembraneModel
from deabayes.systems.solid import FINITE_STRAIN, Note, Solid
from deabayes.systems.specimen_quantities import filled, positive
from deabayes.systems.springs.base import column

ALLOWED_CONSTANT, ALLOWED_VARYING = 1.0, 0.15
"""Allowed error of a step over the tolerance, under constant and under varying voltage. Under
varying voltage the errors of many steps add up. A test checks the tolerance for prior draws."""
FINEST = 1e-13
"""Smallest allowed error over the pre-stretch, close to rounding errors."""
FIRST_STEP = 0.1
"""First step over the time of the fastest mode."""
FOLD_POINTS, FOLD_POINTS_FINE = 32, 400
"""Number of points of the search for pull-in, in the likelihood and for derived quantities."""
REFERENCE_VOLTAGE = 2e3


@dataclass(frozen=True)
class PullIn:
    """End of the near equilibrium, each (W,).

    Attributes
    ----------
    voltage, stretch : at the end of the branch [V], [1].
    fold : whether the end is a fold, which means pull-in. Otherwise the branch reaches the
        breakdown stretch or the lock-up of the Gent spring.
    """

    voltage: FloatArray
    stretch: FloatArray
    fold: NDArray[np.bool_]


@dataclass(frozen=True)
class Initial:
    """Constants at the pre-stretch, the same for all records.

    Attributes
    ----------
    prestress : nominal stress of the relaxed membrane at the pre-stretch [Pa], (W,).
    fast : time of the fastest mode [s], (W,).
    compliance : change of stretch per squared voltage before the units relax, (W,).
    units : (W, n, 5) for `kernel.integrate`.
    """

    prestress: FloatArray
    fast: FloatArray
    compliance: FloatArray
    units: FloatArray


@dataclass(frozen=True)
class Material:
    """Constants of W draws in SI units; NaN if a draw's value is not positive.

    Attributes
    ----------
    modulus, viscosity, inverse_limit : mu_alpha, zeta_alpha, 1/J_alpha, (W,).
    unit_moduli, unit_times : mu_beta, tau_beta, (W, n).
    unit_inverse_limit : 1/J_beta, (W,).
    prestretch, thickness : lambda_p and H, (W,).
    gain : epsilon/H^2, the drive per squared voltage, (W,).
    """

    modulus: FloatArray
    viscosity: FloatArray
    inverse_limit: FloatArray
    unit_moduli: FloatArray
    unit_times: FloatArray
    unit_inverse_limit: FloatArray
    prestretch: FloatArray
    thickness: FloatArray
    gain: FloatArray

    @classmethod
    def from_draws(cls, model: MembraneModel, specimen: Specimen, draws: Draws) -> Self:
        """Compute the constants; a quantity that is not a parameter has the specimen's value."""
        modulus = positive(draws["mu_alpha"])
        unit_moduli, unit_times = model.unit_draws(draws)
        thickness = filled(specimen, "thickness", draws, modulus)
        return cls(
            modulus,
            positive(draws["zeta_alpha"]),
            1.0 / positive(draws["J_alpha"]),
            unit_moduli,
            positive(unit_times),
            1.0 / positive(draws["J_beta"]),
            filled(specimen, "prestretch", draws, modulus),
            thickness,
            filled(specimen, "permittivity", draws, modulus) / (thickness * thickness),
        )

    def constants(
        self, history: Drive, tolerance: float, limit: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return draws (W, 10) and units (W, n, 5) for `kernel.integrate`.

        Parameters
        ----------
        tolerance : error of the stretch relative to its range.
        limit : (W,) largest stretch of a draw; beyond it the draw has failed.
        """
        initial = self._initial
        # Estimate of the range of the stretch before integration. It depends on this draw only.
        scale = initial.compliance * history.peak**2
        scale = scale * np.minimum(1.0, np.ptp(history.edges) / initial.fast)
        estimate = ALLOWED_VARYING if history.varies else ALLOWED_CONSTANT
        allowed = np.maximum(estimate * tolerance * scale, FINEST * self.prestretch)
        columns = (self.prestretch, FIRST_STEP * initial.fast, np.zeros_like(limit), limit,
                   1.0 / allowed, 1.0 / self.viscosity, self.modulus, self.inverse_limit,
                   initial.prestress, self.gain)  # fmt: skip
        return np.stack(columns, axis=1), initial.units

    @cached_property
    def _initial(self) -> Initial:
        """Constants at the pre-stretch, the same for all records."""
        square = self.prestretch * self.prestretch
        prestress, slope = gent_stress(self.prestretch, self.inverse_limit)
        stiffness = self.modulus * slope + 6.0 * self.unit_moduli.sum(axis=1) / square
        weight = self.unit_moduli / column(self.modulus + self.unit_moduli.sum(axis=1))
        parts = (column(self.prestretch), 1.0 / self.unit_times, self.unit_moduli,
                 column(self.unit_inverse_limit), weight)  # fmt: skip
        return Initial(
            self.modulus * prestress,
            self.viscosity / stiffness,
            self.gain * square * self.prestretch / stiffness,
            np.stack(np.broadcast_arrays(*parts), axis=2),
        )

    @property
    def fastest(self) -> FloatArray:
        """Time of the fastest mode at the pre-stretch [s], (W,): zeta_alpha over the stiffness."""
        return self._initial.fast

    def pull_in(self, breakdown: float, points: int = FOLD_POINTS_FINE) -> PullIn:
        """Return the end of the near equilibrium, searched up to the stretch `breakdown`."""
        from deabayes.systems.membrane.static import end_of_branch

        stretch, scaled, fold = end_of_branch(
            self.prestretch, self.inverse_limit, breakdown, points
        )
        return PullIn(np.sqrt(scaled * self.modulus / self.gain), stretch, fold > 0.0)

    def why_lost(self, breakdown: float) -> NDArray[np.str_]:
        """Return in words why the near branch of each draw (W,) ends."""
        locked = np.isnan(gent_stress(self.prestretch, self.inverse_limit)[0])
        end = self.pull_in(breakdown)
        whole = end.stretch >= breakdown
        words = np.where(whole, "beyond the breakdown stretch", "at the Gent spring's lock-up")
        words = np.where(end.fold, "pull-in", words)
        return np.where(locked, "Gent limit below the pre-stretch", words)

    def steady_stretch(self, voltage: float, end: FloatArray) -> FloatArray:
        """Stretch (W,) of the near equilibrium at a voltage; NaN beyond the branch's `end` (W,)."""
        from deabayes.systems.membrane.static import near_equilibrium

        scaled = self.gain * voltage**2 / self.modulus
        return np.asarray(near_equilibrium(self.prestretch, self.inverse_limit, end, scaled))

    def derived(self, breakdown: float) -> dict[str, Derived]:
        """Return eta, t_v, relaxation times, total modulus, steady stretch, pull-in voltage."""
        total = self.modulus + self.unit_moduli.sum(axis=1)
        found = {
            "shear_modulus_total": Derived(
                r"\mu_\mathrm{total}", "Pa", "shear modulus of spring alpha and all units", total
            ),
            "eta_alpha": Derived(
                r"\eta_\alpha", "N s/m", "the paper's viscosity of dashpot alpha, 2 H zeta",
                2.0 * self.thickness * self.viscosity,
            ),
        }  # fmt: skip
        for i in range(1, self.unit_moduli.shape[1] + 1):
            found |= self._derived_of_unit(i)
        pull_in = self.pull_in(breakdown)
        steady = self.steady_stretch(REFERENCE_VOLTAGE, pull_in.stretch)
        found["pull_in_voltage"] = Derived(
            r"\Phi_\mathrm{max}", "V",
            "voltage at which the near equilibrium ends: pull-in, or the breakdown stretch or "
            "lock-up where there is none", pull_in.voltage,
        )  # fmt: skip
        found["steady_stretch_2kV"] = Derived(
            r"\lambda_\infty(2\,\mathrm{kV})", "1",
            "equilibrium stretch at 2 kV; that at the end of the branch where 2 kV is beyond it",
            np.where(np.isfinite(steady), steady, pull_in.stretch),
        )  # fmt: skip
        return found

    def _derived_of_unit(self, i: int) -> dict[str, Derived]:
        modulus, time = self.unit_moduli[:, i - 1], self.unit_times[:, i - 1]
        return {
            f"relaxation_time_{i}": Derived(
                rf"\tau_{{{i}}}(\lambda_p)", "s",
                f"linearised relaxation time of unit {i} at the pre-stretch, tau lambda_p^2/6",
                time * self.prestretch**2 / 6.0,
            ),
            f"eta_beta_{i}": Derived(
                rf"\eta_{{\beta {i}}}", "N s/m", f"the paper's viscosity of unit {i}, 2 H zeta",
                2.0 * self.thickness * modulus * time,
            ),
            f"t_v_{i}": Derived(
                rf"t_{{v {i}}}", "s m", f"the paper's t_v of unit {i}, eta/mu",
                2.0 * self.thickness * time,
            ),
        }  # fmt: skip


def gent_stress(stretch: FloatArray, inverse_limit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nominal equal-biaxial stress over modulus and its slope; NaN past the Gent limit."""
    square = stretch * stretch
    fourth = 1.0 / (square * square)
    argument = positive(1.0 - inverse_limit * (2.0 * square + fourth - 3.0))
    force = stretch - fourth / stretch
    slope = 1.0 + 5.0 * fourth / square
    return force / argument, slope / argument + 4.0 * inverse_limit * (force / argument) ** 2


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
    """Return the Gent law of spring alpha with the relaxation of the units at the pre-stretch."""
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
    """Shares (W, n) of the units in a sudden small change of true stress at the pre-stretch."""
    stretch = material.prestretch
    force, slope = gent_stress(stretch, material.inverse_limit)
    units = 6.0 * material.unit_moduli / stretch[:, None]
    spring = material.modulus * (force + stretch * slope)
    return np.asarray(units / (spring + units.sum(axis=1))[:, None])


def _shares_there(material: Material, small: FloatArray) -> Note:
    """Return the note on the shares at the pre-stretch and the small-strain shares `small`."""
    own = shares_at_prestretch(material)
    each = {f"g_{i}": shares for i, shares in enumerate(own.T, start=1)}
    listed = ", ".join(f"{name} = {{{name}:.6g}}" for name in each)
    values = {"small": small, "own": own.sum(axis=1), **each}
    return Note(SHARES.replace("{each}", listed), values)
