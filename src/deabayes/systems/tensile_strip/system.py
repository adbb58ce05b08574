"""Tensile strip: hyperelastic spring, dashpot and Maxwell units under a prescribed stretch.

This is KV-GM in uniaxial tension, with the dashpot of Nguyen et al. 2021 in the direction of
tension. That is a choice of this model; it does not follow from the membrane's equations. lambda
is the stretch of the strip, xi_i the stretch of dashpot i; at the first knot (at rest)
xi_i = lambda:

    P = P_alpha(lambda) + zeta_alpha lambda'
        + sum_i mu_beta_i (lambda xi_i^-2 - lambda^-2 xi_i)/(1 - (I_i - 3)/J_beta)
    xi_i' = (1/tau_i) (lambda^2 xi_i^-3 - lambda^-1)/(1 - (I_i - 3)/J_beta)
    I_i = lambda^2 xi_i^-2 + 2 xi_i/lambda
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.integrate.rosenbrock import LANES
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Conditions, Derived, Draws, Simulator, System
from deabayes.systems.solid import Solid
from deabayes.systems.specimen_quantities import quantity, uncertain_quantities
from deabayes.systems.springs.base import (
    DEFORMATIONS,
    column,
    principal_stretches,
    unknown_deformation,
)
from deabayes.systems.tensile_strip.candidates import StripModel, examples, solid
from deabayes.systems.tensile_strip.kernel import (
    DEFAULT_TOLERANCE,
    StripRecord,
    record_in_time,
    record_without_time,
    unit_stress,
)

LEFT = 1e-3
"""Scale of the stress left at stretch 1, over the largest spring stress during the record."""
QUANTITIES = {
    "gauge_length": ("L_0", "free length between the clamps"),
    "cross_section": ("A_0", "cross-section of the undeformed strip"),
}
MEANINGS = {
    "stretch": "length over the length without load: 1 at rest",
    "displacement": "elongation since rest, gauge_length (stretch - 1)",
    "nominal_stress": "force over the cross-section of the undeformed strip; pulling is positive",
    "force": "pulling is positive",
    **{name: meaning for name, (_, meaning) in QUANTITIES.items()},
}


class TensileStrip(System):
    """A strip in tension under a prescribed stretch; records of nominal stress or force.

    Parameters
    ----------
    candidate : `kv_gm_<n>` or `<spring>[_<terms>][_units_<n>]`.
    specimen : may give `gauge_length` (for displacements) and `cross_section` (for forces).
    tolerance : error of the response relative to its range.
    """

    name = "tensile_strip"
    protocols = ("relaxation", "load_unload", "step", "sine", "sweep", "quasi_static")
    excitations: ClassVar[Mapping[str, str]] = {"stretch": "1", "displacement": "m"}
    conditions: ClassVar[Conditions] = {
        channel: {"deformation": DEFORMATIONS[0]} for channel in excitations
    }
    units_add = "moduli"
    responses: ClassVar[Mapping[str, str]] = {"nominal_stress": "Pa", "force": "N"}
    zero_at_rest = ("nominal_stress", "force")
    required_quantities: ClassVar[Mapping[str, str]] = {}
    optional_quantities: ClassVar[Mapping[str, str]] = {"gauge_length": "m", "cross_section": "m^2"}
    meanings: ClassVar[Mapping[str, str]] = MEANINGS
    headline = ("shear_modulus_total", "shear_modulus_long_term", "relaxation_time_*")

    def __init__(
        self, candidate: str, specimen: Specimen, tolerance: float = DEFAULT_TOLERANCE
    ) -> None:
        self.candidate = candidate
        self.specimen = specimen
        self.tolerance = tolerance
        self.model = StripModel.from_name(candidate)
        self.order = self.model.order

    @classmethod
    def candidates(cls) -> list[str]:
        """Return examples of candidates."""
        return examples()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters, then `gauge_length`, `cross_section` if with an sd."""
        uncertain = uncertain_quantities(self.specimen, QUANTITIES, self.optional_quantities)
        return (*self.model.parameters(), *uncertain)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return total and long-term modulus, relaxation times at stretch 2, viscosities, mu_0."""
        return self.model.derived(draws)

    def solid(self, draws: Draws) -> Solid:
        """Return the spring's law with the relaxation of the units at stretch 1."""
        return solid(self.model, draws)

    def largest_stretches(self, experiments: Sequence[Experiment]) -> tuple[float, float] | None:
        """Return lambda_1 and lambda_3 with the largest ratio; None if nothing is stretched."""
        reached = []
        for excitation in (experiment.excitation for experiment in experiments):
            _, stretch = self._history(excitation)
            first, _, third = principal_stretches(stretch, self._deformation(excitation))
            largest = int(np.argmax(np.abs(np.log(first / third))))
            reached.append((float(first[largest]), float(third[largest])))
        widest = max(reached, key=lambda pair: abs(np.log(pair[0] / pair[1])))
        return widest if widest[0] != widest[1] else None

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; return a function draws -> response (W, N).

        A row is NaN if the draw passes a Gent limit, at an output or between outputs, or if its
        integration fails.

        Raises
        ------
        UserError
            For an unknown channel or deformation, a missing quantity, times that do not ascend or
            a stretch that is not positive. For a candidate with relaxation units also for a record
            without time, or a deformation other than uniaxial.
        """
        self.check_channels(excitation.name, response)
        if response == "force":
            self.require("cross_section", "a force")
        deformation = self._deformation(excitation)
        uncertain_gauge = self._uncertain_gauge(excitation)
        record = self._record(excitation, np.asarray(coordinate, dtype=float))

        def simulate(draws: Draws) -> FloatArray:
            gauge = self._gauge(draws) if uncertain_gauge else None
            stress = self._nominal_stress(record, draws, gauge, deformation)
            if response == "force":
                stress = stress * column(quantity(self.specimen, "cross_section", draws))
            stress[~np.all(np.isfinite(stress), axis=1)] = np.nan
            return stress

        return simulate

    def _nominal_stress(
        self, record: StripRecord, draws: Draws, gauge: FloatArray | None, deformation: str
    ) -> FloatArray:
        """Nominal stress (W, N); `gauge` (W,) scales the strain and the rate of the draws."""
        held = self._spring_stress(record.spring_stretch, draws, gauge, deformation)
        held[~np.all(np.isfinite(held), axis=1)] = np.nan
        stress = held[:, : record.stretch.size]
        if self.model.kelvin:
            rate = record.rate if gauge is None else column(gauge) * record.rate
            stress += column(draws["zeta_alpha"]) * rate
        if self.model.units > 0:
            peak = np.max(np.abs(stress), axis=1)
            if np.any(peak == 0.0):
                passed = self._spring_stress(record.grid_stretch, draws, gauge, deformation)
                peak = np.where(peak == 0.0, LEFT * np.max(np.abs(passed), axis=1), peak)
            stress += self._unit_stress(record, draws, gauge, peak)
        return stress

    def _spring_stress(
        self, stretch: FloatArray, draws: Draws, gauge: FloatArray | None, deformation: str
    ) -> FloatArray:
        """Nominal stress (W, N) of the spring at nominal stretches (N,)."""
        if gauge is not None:
            stretch = 1.0 + column(gauge) * (stretch - 1.0)
        model = self.model
        return model.spring.nominal_stress(stretch, model.spring_draws(draws), deformation)

    def _unit_stress(
        self, record: StripRecord, draws: Draws, gauge: FloatArray | None, peak: FloatArray
    ) -> FloatArray:
        """Nominal stress of all Maxwell units (W, N).

        `peak` (W,) is the largest stress of the parallel spring and dashpot. It is a scale of the
        response that is known before integration and depends on this draw only.
        """
        modulus, time = self.model.unit_draws(draws)
        walkers, units = modulus.shape
        allowed = np.where(peak > 0.0, self.tolerance * peak, np.inf)
        rows = np.empty((-(-walkers // LANES) * LANES, units, 5))
        rows[:walkers, :, 0] = 1.0 if gauge is None else gauge[:, np.newaxis]
        rows[:walkers, :, 1] = 1.0 / column(draws["J_beta"]) if self.model.kelvin else 0.0
        rows[:walkers, :, 2] = 1.0 / time
        rows[:walkers, :, 3] = modulus
        rows[:walkers, :, 4] = column(allowed) / (units * np.abs(modulus))
        rows[walkers:] = rows[0]
        blocks = rows.reshape(-1, LANES, units, 5).transpose(0, 2, 3, 1)
        stress = np.zeros((blocks.shape[0], record.stretch.size, LANES))
        unit_stress(
            record.duration,
            record.grid_stretch,
            record.first_output,
            record.position,
            record.stretch[record.order],
            np.ascontiguousarray(blocks),
            stress,
        )
        found = np.empty((walkers, record.stretch.size))
        found[:, record.order] = stress.transpose(0, 2, 1).reshape(rows.shape[0], -1)[:walkers]
        return found

    def _record(self, excitation: Excitation, coordinate: FloatArray) -> StripRecord:
        """Return stretch and rate at the outputs, and the steps of the integration."""
        knots, values = self._history(excitation)
        if not excitation.without_time:
            return record_in_time(knots, values, coordinate, self.tolerance)
        if self.model.units > 0:
            raise UserError(
                f"candidate {self.candidate!r} has relaxation units and needs time; a "
                "quasi-static record has none: take a candidate without units, such as ogden_2"
            )
        return record_without_time(self._to_stretch(excitation.name, coordinate))

    def _history(self, excitation: Excitation) -> tuple[FloatArray, FloatArray]:
        """Return the knots and the stretch of an excitation after checking them."""
        knots = np.asarray(excitation.coordinate, dtype=float)
        values = self._to_stretch(excitation.name, np.asarray(excitation.values, dtype=float))
        if not (np.all(np.isfinite(values)) and np.all(values > 0.0)):
            raise UserError(
                f"excitation {excitation.name!r}: stretch must be finite and positive, found "
                f"{np.min(values):g}; check the unit and the gauge length"
            )
        if not excitation.without_time and not np.all(np.diff(knots) > 0.0):
            raise UserError(
                f"excitation {excitation.name!r}: times must ascend; a jump of stretch needs a "
                "duration, and a repeated time must be removed"
            )
        return knots, values

    def _to_stretch(self, channel: str, values: FloatArray) -> FloatArray:
        if channel == "stretch":
            return values
        return 1.0 + values / self.require("gauge_length", "a displacement").value

    def _deformation(self, excitation: Excitation) -> str:
        deformation = str(excitation.conditions.get("deformation", DEFORMATIONS[0]))
        if deformation not in DEFORMATIONS:
            raise unknown_deformation(deformation)
        if deformation != "uniaxial" and self.model.units > 0:
            raise UserError(
                f"candidate {self.candidate!r} has relaxation units, whose equations are given "
                f"for uniaxial tension only, not {deformation}: take a candidate without units"
            )
        return deformation

    def _uncertain_gauge(self, excitation: Excitation) -> bool:
        if excitation.name != "displacement":
            return False
        return self.require("gauge_length", "a displacement").sd is not None

    def _gauge(self, draws: Draws) -> FloatArray:
        """Ratio of the nominal gauge length to the gauge length of the draws, (W,)."""
        return self.specimen.quantities["gauge_length"].value / draws["gauge_length"]
