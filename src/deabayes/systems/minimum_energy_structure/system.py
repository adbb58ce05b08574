r"""Minimum-energy structure: a pre-stretched film that bends a frame, as a slider-crank.

equations.md, section 3 (the paper's (11)-(23)). Two links of length L at the angle theta,
the slider at l = 2L cos theta; an Ogden film, hinges, weight and the electrostatic term at
rest (`static`), Maxwell units along the slider and friction in motion:

    [2J + 2 m_1 l_m^2 + C sin^2 theta] theta'' + C sin theta cos theta theta'^2
        + 2 m_1 g l_m cos theta + 4 K theta
        = A_0 t_0 sigma_x tan theta + 2L sin theta sum_i k_i x_i + Q_f
    x_i' = -2L sin theta theta' - x_i/tau_i,   C = 4L [m_1 (L - l_m) + m_2 L]
    Q_f = -4 eta_0 L^2 sin^2 theta theta' (viscous), or -2L sin theta F_c sign(theta') (dry,
        smoothed below 0.5 mm/s of the slider)

The paper calls eta_0 a Coulomb coefficient but gives it N s/m, hence viscous. Its units carry
nothing at rest, as its identification in two steps needs. The hinges' stiffness follows from
the rest angle; a measured one, or a frame it is computed from, is a datum on that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Excitation, FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.integrate.drive import Drive
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Conditions, Derived, Draws, Simulator, System, once
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
from deabayes.systems.minimum_energy_structure.motion import Motion, follow
from deabayes.systems.minimum_energy_structure.static import STEEPEST, Structure
from deabayes.systems.solid import Solid
from deabayes.systems.specimen_quantities import uncertain_quantities

DEFAULT_TOLERANCE = 1e-6
LIKELIHOOD_TOLERANCE, ROUGH_TOLERANCE = 1e-5, 1e-4
ROUGH_STEPS = 40
"""Of the integration, per sample of the record: a draw of the prior that needs more is lost in a
rough solution. One such draw took as long as a thousand others."""
"""Move the log-likelihood of the reference specimen's sines by 0.003 in 0.6 of the time, and by
0.03 in 0.4 of it."""
AT_VOLTAGE = 5e3
CHUNK = 2048
"""Draws whose branches are held at once: 200 angles each."""
PREHISTORIES = ("rest", "equilibrium")


class MinimumEnergyStructure(System):
    """A bending actuator: blocking force at rest, or the slider's displacement in time.

    Parameters
    ----------
    candidate : `<spring>[_<terms>]` for what is at rest, with `_units_<n>` for motion, and
        `_dry` behind that for dry instead of viscous friction.
    specimen : must give the links, the film and the rest angle; may give `hinge_stiffness`
        (or the frame it follows from) with an sd, `relative_permittivity`, `gravity` (0 for a
        structure that lies on its side).
    tolerance : error of the displacement relative to its range.
    steps_per_sample : of the integration; a draw that needs more has no response. None: no limit
        but the integrator's own.
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
        """Candidates that can be built."""
        return examples()

    def parameters(self) -> tuple[Parameter, ...]:
        """Material parameters, then the specimen's quantities that carry an sd."""
        units = {**self.required_quantities, **self.optional_quantities}
        known = "relative_permittivity" in self.specimen.quantities
        uncertain = uncertain_quantities(self.specimen, UNCERTAIN, units)
        stretch = self.specimen.quantities["prestretch"].value
        first = stretch * np.cos(self.specimen.quantities["rest_angle"].value)
        return (*self.model.parameters(known, (first, 1.0 / (stretch * first))), *uncertain)

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; returns draws -> response (W, N).

        At rest: the force on what holds the slider, outwards, at its displacements, under the
        constant `voltage` [V] of the record's conditions. In motion: the displacement under a
        voltage that is linear between its knots (a smooth curve where they are samples of one,
        see `integrate.drive`) and zero before the first. The structure starts at rest without
        voltage, or, with the condition `prehistory: equilibrium`, where its first voltage was on
        until it had settled.

        A row is NaN where a draw leaves the bent branch or fails.

        Raises
        ------
        UserError
            Unknown channel, a voltage that is no history in time, motion for a candidate
            without units.
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
        from deabayes.systems.minimum_energy_structure.step import displacement

        order = np.argsort(coordinate, kind="stable")
        times = np.ascontiguousarray(coordinate[order])
        back = np.argsort(order)
        held = self._held(excitation)
        history = self._history(excitation, times, held)

        def simulate(draws: Draws) -> FloatArray:
            structure = self.structure(draws)
            angle = self._follow(structure, history, times, held).angle[:, back]
            return np.asarray(displacement(angle, structure.length, structure.rest))

        return simulate

    def _follow(
        self, structure: Structure, history: Drive, times: FloatArray, held: float
    ) -> Motion:
        start = structure.rest if held == 0.0 else structure.equilibrium(held)
        most = None if self.steps_per_sample is None else self.steps_per_sample * times.size
        return follow(structure, history, times, self.tolerance, start, most)

    def _held(self, excitation: Excitation) -> float:
        """The voltage [V] at which the structure was before the record."""
        prehistory = excitation.conditions.get("prehistory", PREHISTORIES[0])
        if prehistory not in PREHISTORIES:
            raise UserError(
                f"condition prehistory must be one of {', '.join(PREHISTORIES)}; "
                f"found {prehistory!r}"
            )
        return float(excitation.values[0]) if prehistory == "equilibrium" else 0.0

    def _history(self, excitation: Excitation, times: FloatArray, held: float) -> Drive:
        if self.model.units == 0:
            raise UserError(
                f"candidate {self.candidate!r} has no relaxation units, so it does not move in "
                "time; take one that has, such as ogden_1_units_1"
            )
        return voltage_history(excitation, times, self.tolerance, before=held)

    def for_likelihood(self, rough: bool = False) -> System:
        """Itself, less accurately solved, unless built for more or less than the usual accuracy."""
        if self.tolerance != DEFAULT_TOLERANCE:
            return self
        accuracy = (ROUGH_TOLERANCE, ROUGH_STEPS) if rough else (LIKELIHOOD_TOLERANCE, None)
        return MinimumEnergyStructure(self.candidate, self.specimen, *accuracy)

    def structure(self, draws: Draws) -> Structure:
        """The constants of the draws."""
        return once(
            draws,
            (self, "structure"),
            lambda: Structure.from_draws(self.model, self.specimen, draws),
        )

    def log_likelihood_of_quantities(self, draws: Draws) -> FloatArray:
        """log N(measured; K(theta), sd) of the hinges' stiffness, (W,); zero if not measured."""
        if self.measured is None:
            return super().log_likelihood_of_quantities(draws)
        sd = self.measured.sd or np.nan
        residual = (self.measured.value - self.structure(draws).hinge / 4.0) / sd
        return np.asarray(-0.5 * residual**2 - np.log(sd * np.sqrt(2.0 * np.pi)))

    def stated(self) -> Mapping[str, Quantity]:
        """The specimen's quantities; the hinges' stiffness also where the frame tells it."""
        given = self.specimen.quantities
        return given if self.measured is None else {**given, "hinge_stiffness": self.measured}

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """mu_0, K, where the structure snaps flat, force and displacement at 5 kV, xi_i."""
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
        """The film; units and friction act along the slider: see `film`."""
        return solid(self.structure(draws))

    def response_to(self, excitation: str) -> str:
        """A force over displacements, a displacement under a voltage."""
        return "force" if excitation == "displacement" else "displacement"

    def why_failed(self, draws: Draws) -> NDArray[np.str_]:
        """Hinges that would have to push, no stable rest, or a bent branch that was left, (W,)."""
        structure = self.structure(draws)
        pushing = np.isnan(structure.hinge)
        unstable = np.isnan(structure.stiffness_at_rest)
        words = np.where(unstable, "unstable at its rest angle", "left the bent branch")
        return np.where(pushing, "the film would need hinges that push", words)

    def failure_note(self, excitation: Excitation, coordinate: FloatArray, draws: Draws) -> str:
        """Why; of a force, first where the slider is asked to go beyond what the links reach."""
        structure = self.structure(draws)
        reach = 2.0 * structure.length * (1.0 - np.cos(structure.rest))
        if excitation.name == "displacement" and np.all(np.max(coordinate) > reach):
            furthest = 1e3 * float(np.median(reach))
            return f"beyond {furthest:.3g} mm, where its links are straight"
        return super().failure_note(excitation, coordinate, draws)
