r"""Membrane actuator: KV-GM under a voltage, equal-biaxial (Nguyen et al. 2021).

A Kelvin-Voigt unit alpha is parallel to n Maxwell units beta_i; all springs are Gent springs.
lambda is the stretch of the membrane, xi_i the stretch of dashpot i. Before the voltage, both are
lambda_p (pre-stretched, relaxed):

    zeta_alpha lambda' = epsilon (Phi/H)^2 lambda^3 + sigma - P_alpha(lambda)
                         - sum_i mu_beta_i (lambda xi_i^-2 - lambda^-5 xi_i^4)/g_i
    xi_i' = (1/tau_i) (lambda^2 xi_i^-3 - lambda^-4 xi_i^3)/g_i
    g_i = 1 - (2 lambda^2 xi_i^-2 + lambda^-4 xi_i^4 - 3)/J_beta,   sigma = P_alpha(lambda_p)

These are (12)-(13) with zeta = eta/(2H) [Pa s] and tau = zeta/mu [s]; sigma is nominal. In the
paper, (10) and (14) lack a factor 2 in the electrostatic term, which the variation, (9) and (12)
have. The paper's t_v = eta/mu is not a time: the relaxation time at xi = lambda is
(zeta/mu) lambda^2/6. Inertia, (14), adds (rho L^2/3) lambda'' on the left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Excitation, Experiment, FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.integrate.arrow import Motion
from deabayes.integrate.drive import Drive
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Conditions, Derived, Draws, Simulator, System, cached
from deabayes.systems.electrostatics import voltage_history
from deabayes.systems.membrane.candidates import MembraneModel
from deabayes.systems.membrane.inertia import integrate_with_inertia
from deabayes.systems.membrane.kernel import integrate
from deabayes.systems.membrane.material import FOLD_POINTS, Material, PullIn, solid
from deabayes.systems.solid import Solid
from deabayes.systems.specimen_quantities import filled, quantity, uncertain_quantities
from deabayes.systems.spring_candidates import kv_gm_examples
from deabayes.systems.springs.base import column
from deabayes.systems.springs.stretched import StretchedSpring, equal_biaxial

DEFAULT_TOLERANCE = 1e-6
BREAKDOWN_STRETCH = 6.0
QUANTITIES = {
    "permittivity": (r"\varepsilon", "permittivity, absolute: relative one times 8.854 pF/m"),
    "thickness": ("H", "thickness before stretching"),
    "prestretch": (r"\lambda_p", "stretch at rest, the same in both directions"),
    "side_length": ("L", "side before stretching"),
    "density": (r"\rho", "density"),
}
"""Quantity that is a parameter if it has an sd -> symbol and meaning."""
MEANINGS = {
    "stretch": "side over the side before stretching: prestretch at rest",
    "displacement": "growth of the whole side since rest, side_length (stretch - prestretch)",
    "area": "of the whole membrane, (side_length stretch)^2",
    "breakdown_stretch": "stretch beyond which a prediction counts as failed, default 6",
    **{name: meaning for name, (_, meaning) in QUANTITIES.items()},
}


class Membrane(System):
    """A pre-stretched membrane under a voltage; records of stretch, displacement or area.

    Parameters
    ----------
    candidate : `kv_gm_<n>`, or `kv_gm_<n>_inertia` (slow; for comparison).
    specimen : must give `thickness` H, `permittivity` and `prestretch`. Displacements, areas and
        inertia need `side_length` L; inertia also needs `density`. `breakdown_stretch` (default 6)
        is the largest stretch.
    tolerance : error of the stretch relative to its range.
    """

    name = "membrane"
    protocols = ("step", "creep", "sine", "sweep")
    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V"}
    in_time = ("voltage",)
    conditions: ClassVar[Conditions] = {}
    even = ("voltage",)
    units_add = "moduli"
    responses: ClassVar[Mapping[str, str]] = {"stretch": "1", "displacement": "m", "area": "m^2"}
    zero_at_rest = ("displacement",)
    required_quantities: ClassVar[Mapping[str, str]] = {
        "thickness": "m",
        "permittivity": "F/m",
        "prestretch": "1",
    }
    optional_quantities: ClassVar[Mapping[str, str]] = {
        "side_length": "m",
        "density": "kg/m^3",
        "breakdown_stretch": "1",
    }
    meanings: ClassVar[Mapping[str, str]] = MEANINGS
    headline = (
        "shear_modulus_total",
        "mu_alpha",
        "relaxation_time_*",
        "pull_in_voltage",
        "zeta_alpha",
    )

    def __init__(
        self,
        candidate: str,
        specimen: Specimen,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> None:
        self.candidate = candidate
        self.specimen = specimen
        self.tolerance = tolerance
        self.model = MembraneModel.from_name(candidate)
        self.order = self.model.units
        for name in self.required_quantities:
            self.require(name)
        for name in ("side_length", "density") if self.model.inertia else ():
            self.require(name, "inertia")
        given = specimen.quantities.get("breakdown_stretch")
        self.breakdown = BREAKDOWN_STRETCH if given is None else given.value
        if not specimen.quantities["prestretch"].value < self.breakdown:
            raise UserError(
                f"specimen {specimen.name!r}: prestretch is not below breakdown_stretch "
                f"{self.breakdown:g}; give breakdown_stretch in specimen.yaml"
            )

    def stretched_springs(self, experiments: Sequence[Experiment]) -> tuple[StretchedSpring, ...]:
        """Return spring alpha, if the records stretch it."""
        return equal_biaxial("mu_alpha", "J_alpha", self.specimen, experiments)

    @classmethod
    def candidates(cls) -> list[str]:
        """Return examples of candidates."""
        return kv_gm_examples()

    @property
    def time_scale(self) -> float:
        """Return 6/lambda_p^2: a unit relaxes with tau lambda_p^2/6 at the pre-stretch."""
        return 6.0 / self.specimen.quantities["prestretch"].value ** 2

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters, then the used quantities that have an sd."""
        units = {**self.required_quantities, **self.optional_quantities}
        used = {n: s for n, s in QUANTITIES.items() if n != "density" or self.model.inertia}
        return (*self.model.parameters(), *uncertain_quantities(self.specimen, used, units))

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; return a function draws -> response (W, N).

        The voltage is zero before its first knot (see `systems.electrostatics`).

        A row is NaN if the draw has pull-in (its stretch passes the end of the branch of the near
        equilibrium), passes the breakdown stretch, or fails.

        Raises
        ------
        UserError
            For an unknown channel, a missing quantity, or a voltage with invalid times or values.
        """
        self.check_channels(excitation.name, response)
        if response != "stretch":
            self.require("side_length", f"a {response}")
        coordinate = np.asarray(coordinate, dtype=float)
        order = np.argsort(coordinate, kind="stable")
        times = np.ascontiguousarray(coordinate[order])
        in_order = bool(np.all(order == np.arange(order.size)))
        history = self._history(excitation, times)

        def simulate(draws: Draws) -> FloatArray:
            ascending = self._followed(history, times, draws).values
            stretch = ascending
            if not in_order:
                stretch = np.empty_like(ascending)
                stretch[:, order] = ascending
            return self._response(stretch, response, draws)

        return simulate

    def lost(
        self, excitation: Excitation, last: float, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        """Return when and at which voltage a draw leaves the near branch or fails.

        Returns
        -------
        Time [s] (accurate to one integration step) and voltage [V], each (W,); NaN for draws
        that do not fail until the time `last`.
        """
        times = np.array([last])
        history = self._history(excitation, times)
        ended = self._followed(history, times, draws).ended
        volts = np.full(ended.shape, np.nan)
        gone = np.isfinite(ended)
        volts[gone] = history.at(ended[gone])
        return ended, volts

    def _history(self, excitation: Excitation, times: FloatArray) -> Drive:
        if excitation.without_time:
            raise UserError("a membrane needs the voltage in time; a quasi-static record has none")
        return voltage_history(excitation, times, self.tolerance)

    def _followed(self, history: Drive, times: FloatArray, draws: Draws) -> Motion:
        """Integrate the draws under the voltage history, with outputs at ascending `times`."""
        material = self._material(draws)
        limit = cached(
            draws,
            (self, "limit"),
            lambda: material.pull_in(self.breakdown, FOLD_POINTS).stretch,
        )
        mass = self._mass(draws, material.modulus.size) if self.model.inertia else None
        return follow(material, history, times, self.tolerance, limit, mass)

    def _mass(self, draws: Draws, walkers: int) -> FloatArray:
        """Return rho L^2/3 of (14), (W,)."""
        side = quantity(self.specimen, "side_length", draws)
        mass = side * side * quantity(self.specimen, "density", draws) / 3.0
        return np.ascontiguousarray(np.broadcast_to(mass, walkers))

    def pull_in(self, draws: Draws) -> PullIn:
        """Return the end of the near equilibrium, with the largest steady voltage."""
        return self._material(draws).pull_in(self.breakdown)

    def steady_stretch(self, draws: Draws, voltage: float) -> FloatArray:
        """Stretch (W,) of the near equilibrium at a voltage [V]; NaN beyond pull-in."""
        return self._material(draws).steady_stretch(voltage, self.pull_in(draws).stretch)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return eta, t_v, relaxation times, total modulus, steady stretch, pull-in voltage."""
        return self._material(draws).derived(self.breakdown)

    def solid(self, draws: Draws) -> Solid:
        """Return a Gent solid that relaxes like the units at the pre-stretch, see `material`."""
        material, density = self._material(draws), None
        if "density" in self.specimen.quantities:
            density = filled(self.specimen, "density", draws, material.modulus)
        return solid(material, density)

    def why_failed(self, draws: Draws) -> NDArray[np.str_]:
        """Return in words why each draw (W,) failed, for example pull-in."""
        return self._material(draws).why_lost(self.breakdown)

    def failure_note(self, excitation: Excitation, coordinate: FloatArray, draws: Draws) -> str:
        """Return why draws fail, and at which time and voltage they leave the near branch."""
        note = super().failure_note(excitation, coordinate, draws)
        time, voltage = self.lost(excitation, float(np.max(coordinate)), draws)
        gone = np.isfinite(time)
        if not gone.any():
            return note
        low, middle, high = np.quantile(time[gone], [0.05, 0.5, 0.95])
        volts = np.quantile(np.abs(voltage[gone]), [0.05, 0.5, 0.95]) / 1e3
        if gone.size == 1:
            return f"{note}; at {middle:.3g} s under {volts[1]:.3g} kV"
        return (
            f"{note}; at {middle:.3g} s ({low:.3g} to {high:.3g}) under "
            f"{volts[1]:.3g} kV ({volts[0]:.3g} to {volts[2]:.3g})"
        )

    def _material(self, draws: Draws) -> Material:
        return cached(
            draws,
            (self, "material"),
            lambda: Material.from_draws(self.model, self.specimen, draws),
        )

    def _response(self, stretch: FloatArray, response: str, draws: Draws) -> FloatArray:
        if response == "stretch":
            return stretch
        side = column(quantity(self.specimen, "side_length", draws))
        if response == "displacement":
            return np.asarray(
                side * (stretch - column(quantity(self.specimen, "prestretch", draws)))
            )
        return np.asarray((side * stretch) ** 2)


def follow(
    material: Material,
    history: Drive,
    times: FloatArray,
    tolerance: float,
    limit: FloatArray,
    mass: FloatArray | None = None,
) -> Motion:
    """Integrate the draws under a voltage history, from rest at the pre-stretch.

    Parameters
    ----------
    times : (N,) ascending [s].
    tolerance : error of the stretch relative to its range.
    limit : (W,) largest stretch of a draw; beyond it the draw has failed.
    mass : rho L^2/3 of (14), (W,); None without inertia.
    """
    constants, units = material.constants(history, tolerance, limit)
    found = Motion.empty(material.modulus.size, times.size)
    results = found.values, found.steps, found.ended
    pieces = history.edges, history.coefficients, history.restart
    if mass is None:
        integrate(*pieces, times, constants, units, *results)
    else:
        integrate_with_inertia(*pieces, times, constants, units, mass, *results)
    return found
