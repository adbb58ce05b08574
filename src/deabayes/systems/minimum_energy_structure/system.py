r"""Minimum-energy structure: a pre-stretched film that bends a frame, as a slider-crank.

See equations.md, section 3, and (11)-(23) of the paper. Two links of length L have the angle
theta; the slider is at l = 2L cos theta. The model at rest (`static`) has an Ogden film, hinges,
weight and the electrostatic term. In motion, Maxwell units along the slider and friction are added:

    [2J + 2 m_1 l_m^2 + C sin^2 theta] theta'' + C sin theta cos theta theta'^2
        + 2 m_1 g l_m cos theta + 4 K theta
        = A_0 t_0 sigma_x tan theta + 2L sin theta sum_i k_i x_i + Q_f
    x_i' = -2L sin theta theta' - x_i/tau_i,   C = 4L [m_1 (L - l_m) + m_2 L]
    Q_f = -4 eta_0 L^2 sin^2 theta theta' (viscous), or -2L sin theta F_c sign(theta') (dry,
        smoothed below 0.5 mm/s of the slider)

The paper calls eta_0 a Coulomb coefficient but gives it in N s/m, so it is viscous here. The
Maxwell units carry no force at rest, as the paper's identification in two steps needs. The rest
angle determines the stiffness of the hinges. A measured stiffness, or one computed from the
frame, is compared with it in the likelihood.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Excitation, FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.integrate.arrow import Motion
from deabayes.integrate.drive import Drive
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Conditions, Derived, Draws, Simulator, System, cached
from deabayes.systems.electrostatics import voltage_history
from deabayes.systems.minimum_energy_structure.candidates import (
    MEANINGS,
    OPTIONAL,
    REQUIRED,
    UNCERTAIN,
    StructureModel,
    examples,
    measured_hinge,
)
from deabayes.systems.minimum_energy_structure.film import solid
from deabayes.systems.minimum_energy_structure.motion import follow
from deabayes.systems.minimum_energy_structure.static import STEEPEST, Structure
from deabayes.systems.solid import Solid
from deabayes.systems.specimen_quantities import uncertain_quantities

DEFAULT_TOLERANCE = 1e-6
LIKELIHOOD_TOLERANCE, ROUGH_TOLERANCE = 1e-5, 1e-4
"""They change the log-likelihood of the reference specimen's sines by 0.003 and 0.03, and need
0.6 and 0.4 of the computing time."""
ROUGH_STEPS = 40
"""Largest number of integration steps per sample in a rough solution; a draw that needs more has
failed. One such draw of the prior took as long as a thousand others."""
AT_VOLTAGE = 5e3
CHUNK = 2048
"""Number of draws whose branches, of 200 angles each, are in memory at the same time."""
PREHISTORIES = ("rest", "equilibrium")


class MinimumEnergyStructure(System):
    """A bending actuator: blocking force at rest, or the slider's displacement in time.

    Parameters
    ----------
    candidate : `<spring>[_<terms>]` for records at rest. Add `_units_<n>` for motion, and then
        `_dry` for dry instead of viscous friction.
    specimen : must give the links, the film and the rest angle. May give `hinge_stiffness` with an
        sd (or the dimensions of the frame), `relative_permittivity`, and `gravity` (0 for a
        structure that lies on its side).
    tolerance : error of the displacement relative to its range.
    steps_per_sample : largest number of integration steps per sample; a draw that needs more has
        failed. None: only the limit of the integrator.
    """

    name = "minimum_energy_structure"
    protocols = ("quasi_static", "sine", "sweep", "step", "creep")
    excitations: ClassVar[Mapping[str, str]] = {"displacement": "m", "voltage": "V"}
    in_time = ("voltage",)
    without_time = ("displacement",)
    even = ("voltage",)
    conditions: ClassVar[Conditions] = {
        "displacement": {"voltage": None},
        "voltage": {"prehistory": PREHISTORIES[0]},
    }
    units_add = "moduli"
    responses: ClassVar[Mapping[str, str]] = {"force": "N", "displacement": "m"}
    zero_at_rest = ("displacement",)
    required_quantities: ClassVar[Mapping[str, str]] = REQUIRED
    optional_quantities: ClassVar[Mapping[str, str]] = OPTIONAL
    meanings: ClassVar[Mapping[str, str]] = MEANINGS
    headline = ("mu_0", "relative_permittivity", "natural_frequency", "tau_*", "snap_voltage",
                "blocking_force_*", "free_displacement_*")  # fmt: skip

    def __init__(
        self,
        candidate: str,
        specimen: Specimen,
        tolerance: float = DEFAULT_TOLERANCE,
        steps_per_sample: int | None = None,
    ) -> None:
        self.candidate = candidate
        self.specimen = specimen
        self.tolerance = tolerance
        self.steps_per_sample = steps_per_sample
        self.model = StructureModel.from_name(candidate)
        self.order = self.model.order
        for name in self.required_quantities:
            self.require(name)
        if "gravity" in specimen.quantities and specimen.quantities["gravity"].sd is not None:
            raise UserError(
                f"specimen {specimen.name!r}: gravity is taken as exact; remove its sd from "
                "quantities in specimen.yaml"
            )
        rest = specimen.quantities["rest_angle"].value
        if not np.radians(5.0) < rest < STEEPEST:
            raise UserError(
                f"specimen {specimen.name!r}: rest_angle must lie between 5 and "
                f"{np.degrees(STEEPEST):.0f} degrees, found {np.degrees(rest):.4g}; it is the "
                "angle of the links to the line between their ends"
            )
        self.measured = measured_hinge(specimen)

    @classmethod
    def candidates(cls) -> list[str]:
        """Return examples of candidates."""
        return examples()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters, then the specimen's quantities that have an sd."""
        units = {**self.required_quantities, **self.optional_quantities}
        known = "relative_permittivity" in self.specimen.quantities
        uncertain = uncertain_quantities(self.specimen, UNCERTAIN, units)
        stretch = self.specimen.quantities["prestretch"].value
        first = stretch * np.cos(self.specimen.quantities["rest_angle"].value)
        return (*self.model.parameters(known, (first, 1.0 / (stretch * first))), *uncertain)

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; return a function draws -> response (W, N).

        At rest, the response is the outward force on the support of the slider. It is computed at
        the given displacements, under the constant `voltage` [V] of the record's conditions.

        In motion, the response is the displacement under a voltage. The voltage is linear between
        its knots, or a smooth curve if the knots sample one (see `integrate.drive`), and zero
        before the first knot. The structure starts at rest without voltage. With the condition
        `prehistory: equilibrium` it starts in equilibrium under the first voltage of the record.

        A row is NaN if the draw leaves the bent branch or fails.

        Raises
        ------
        UserError
            For an unknown channel, for a voltage with invalid times or values, or for motion with a
            candidate that has no units.
        """
        self.check_channels(excitation.name, response)
        coordinate = np.asarray(coordinate, dtype=float)
        if (excitation.name == "displacement") != (response == "force"):
            raise UserError(
                f"response {response!r} does not go with excitation {excitation.name!r}: a force "
                "is recorded at rest over displacements, a displacement in time under a voltage"
            )
        if response == "force":
            return self._force(excitation, coordinate)
        return self._displacement(excitation, coordinate)

    def _force(self, excitation: Excitation, coordinate: FloatArray) -> Simulator:
        voltage = excitation.conditions.get("voltage")
        if voltage is None or isinstance(voltage, str):
            raise UserError(
                "a record of force over displacement needs its constant voltage: a column "
                "'voltage' in the record, or voltage_kV in experiments.csv; in Python "
                "conditions={'voltage': 5000.0}"
            )

        def simulate(draws: Draws) -> FloatArray:
            force = self.structure(draws).force(coordinate, voltage)
            force[~np.all(np.isfinite(force), axis=1)] = np.nan
            return force

        return simulate

    def _displacement(self, excitation: Excitation, coordinate: FloatArray) -> Simulator:
        from deabayes.systems.minimum_energy_structure.kernel import displacement

        order = np.argsort(coordinate, kind="stable")
        times = np.ascontiguousarray(coordinate[order])
        back = np.argsort(order)
        initial = self._initial_voltage(excitation)
        history = self._history(excitation, times, initial)

        def simulate(draws: Draws) -> FloatArray:
            structure = self.structure(draws)
            angle = self._follow(structure, history, times, initial).values[:, back]
            return np.asarray(displacement(angle, structure.length, structure.rest))

        return simulate

    def _follow(
        self, structure: Structure, history: Drive, times: FloatArray, initial: float
    ) -> Motion:
        start = structure.rest if initial == 0.0 else structure.equilibrium(initial)
        most = None if self.steps_per_sample is None else self.steps_per_sample * times.size
        return follow(structure, history, times, self.tolerance, start, most)

    def _initial_voltage(self, excitation: Excitation) -> float:
        """Return the voltage [V] before the start of the record."""
        prehistory = excitation.conditions.get("prehistory", PREHISTORIES[0])
        if prehistory not in PREHISTORIES:
            raise UserError(
                f"condition prehistory must be one of {', '.join(PREHISTORIES)}; "
                f"found {prehistory!r}"
            )
        return float(excitation.values[0]) if prehistory == "equilibrium" else 0.0

    def _history(self, excitation: Excitation, times: FloatArray, initial: float) -> Drive:
        if self.model.units == 0:
            raise UserError(
                f"candidate {self.candidate!r} has no relaxation units, so it does not move in "
                "time; take one that has, such as ogden_1_units_1"
            )
        return voltage_history(excitation, times, self.tolerance, before=initial)

    def for_likelihood(self, rough: bool = False) -> System:
        """Return the system with less accuracy; unchanged if its tolerance is not the default."""
        if self.tolerance != DEFAULT_TOLERANCE:
            return self
        accuracy = (ROUGH_TOLERANCE, ROUGH_STEPS) if rough else (LIKELIHOOD_TOLERANCE, None)
        return MinimumEnergyStructure(self.candidate, self.specimen, *accuracy)

    def structure(self, draws: Draws) -> Structure:
        """Return the constants of the structure for the draws."""
        return cached(
            draws,
            (self, "structure"),
            lambda: Structure.from_draws(self.model, self.specimen, draws),
        )

    def log_likelihood_of_quantities(self, draws: Draws) -> FloatArray:
        """log N(measured; K, sd) of the hinges' stiffness K, (W,); zero if K is not measured."""
        if self.measured is None:
            return super().log_likelihood_of_quantities(draws)
        sd = self.measured.sd or np.nan
        residual = (self.measured.value - self.structure(draws).hinge / 4.0) / sd
        return np.asarray(-0.5 * residual**2 - np.log(sd * np.sqrt(2.0 * np.pi)))

    def stated(self) -> Mapping[str, Quantity]:
        """Return the specimen's quantities, with the hinges' stiffness computed from the frame."""
        given = self.specimen.quantities
        return given if self.measured is None else {**given, "hinge_stiffness": self.measured}

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return mu_0, K, the snap voltage, force and displacement at 5 kV, f_0 and xi_i."""
        from deabayes.systems.minimum_energy_structure.film import derived

        count = next(iter(draws.values())).size
        parts = [
            derived(self.structure({n: v[k : k + CHUNK] for n, v in draws.items()}), AT_VOLTAGE)
            for k in range(0, count, CHUNK)
        ]
        return {
            name: replace(one, values=np.concatenate([part[name].values for part in parts]))
            for name, one in parts[0].items()
        }

    def solid(self, draws: Draws) -> Solid:
        """Return the film as a solid; notes describe units and friction, see `film`."""
        return solid(self.structure(draws))

    def response_to(self, excitation: str) -> str:
        """Return `force` for the excitation displacement, `displacement` for a voltage."""
        return "force" if excitation == "displacement" else "displacement"

    def why_failed(self, draws: Draws) -> NDArray[np.str_]:
        """Return why each draw (W,) failed: hinges that push, unstable at rest, or left branch."""
        structure = self.structure(draws)
        pushing = np.isnan(structure.hinge)
        unstable = np.isnan(structure.stiffness_at_rest)
        words = np.where(unstable, "unstable at its rest angle", "left the bent branch")
        return np.where(pushing, "the film would need hinges that push", words)

    def failure_note(self, excitation: Excitation, coordinate: FloatArray, draws: Draws) -> str:
        """Return why draws failed; for a force, check first whether the links reach that far."""
        structure = self.structure(draws)
        reach = 2.0 * structure.length * (1.0 - np.cos(structure.rest))
        if excitation.name == "displacement" and np.all(np.max(coordinate) > reach):
            furthest = 1e3 * float(np.median(reach))
            return f"beyond {furthest:.3g} mm, where its links are straight"
        return super().failure_note(excitation, coordinate, draws)
