"""Tensile strip: hyperelastic spring, dashpot and Maxwell units under a prescribed stretch.

KV-GM in uniaxial tension, with the dashpot of Nguyen et al. 2021 per direction (a choice
of the model, not a consequence of the membrane's equations), lambda the stretch and xi_i
that of dashpot i, xi_i = lambda at the first knot (at rest):

    P = P_alpha(lambda) + zeta_alpha lambda'
        + sum_i mu_beta_i (lambda xi_i^-2 - lambda^-2 xi_i)/(1 - (I_i - 3)/J_beta)
    xi_i' = (1/tau_i) (lambda^2 xi_i^-3 - lambda^-1)/(1 - (I_i - 3)/J_beta)
    I_i = lambda^2 xi_i^-2 + 2 xi_i/lambda
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deabayes.distributions import TruncatedNormal
from deabayes.experiment import Excitation, FloatArray, Quantity, Specimen
from deabayes.faults import UserError, nearest
from deabayes.integrate.grid import GridSettings, graded_grid, simplify
from deabayes.parameter import Parameter
from deabayes.springs.base import DEFORMATIONS, column
from deabayes.systems.base import Derived, Draws, Simulator, System
from deabayes.systems.strip_candidates import StripModel, examples

DEFAULT_TOLERANCE = 1e-6
QUANTITIES = {
    "gauge_length": ("L_0", "free length between the clamps"),
    "cross_section": ("A_0", "cross-section of the undeformed strip"),
}


@dataclass(frozen=True)
class StripRecord:
    """What of one record does not depend on draws.

    Attributes
    ----------
    stretch, rate : (N,) at the outputs; the rate at a knot is that after it.
    duration, grid_stretch : (S,) grid steps and (S + 1,) the stretch at their ends.
    first_output : (S + 1,) outputs of step s are first_output[s] to first_output[s + 1].
    order, position : (N,) outputs in ascending time, and where each lies in its step.
    """

    stretch: FloatArray
    rate: FloatArray
    duration: FloatArray
    grid_stretch: FloatArray
    first_output: np.ndarray
    order: np.ndarray
    position: FloatArray


class TensileStrip(System):
    """A strip in tension, stretch prescribed, nominal stress or force recorded.

    Parameters
    ----------
    candidate : `kv_gm_<n>` or `<spring>[_<terms>][_units_<n>]`.
    specimen : may give `gauge_length` (for displacements), `cross_section` (for forces).
    tolerance : error of the response relative to its peak, per step of the integration.
    """

    name = "tensile_strip"
    protocols = ("relaxation", "load_unload", "step", "sine", "quasi_static")
    excitations = {"stretch": "1", "displacement": "m"}
    responses = {"nominal_stress": "Pa", "force": "N"}
    required_quantities: Mapping[str, str] = {}
    optional_quantities = {"gauge_length": "m", "cross_section": "m^2"}

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
        """Candidates that can be built."""
        return examples()

    def parameters(self) -> tuple[Parameter, ...]:
        """Material parameters, then `gauge_length` and `cross_section` if they carry an sd."""
        uncertain = []
        for name, (symbol, description) in QUANTITIES.items():
            quantity = self.specimen.quantities.get(name)
            if quantity is not None and quantity.sd is not None:
                prior = TruncatedNormal(quantity.value, quantity.sd, 0.0, np.inf)
                source = quantity.source or f"specimen {self.specimen.name}"
                unit = self.optional_quantities[name]
                uncertain.append(Parameter(name, symbol, unit, description, prior, source))
        return self.model.parameters() + tuple(uncertain)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Total and long-term modulus, relaxation times at stretch 2, viscosities, mu_0."""
        return self.model.derived(draws)

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; returns draws -> response (W, N).

        A row is NaN where a draw passes a Gent limit or its integration fails.

        Raises
        ------
        UserError
            Unknown channel or deformation; a missing quantity; a record without time, or
            a deformation other than uniaxial, for a candidate with relaxation units; an
            excitation that is not an ascending history of positive stretch.
        """
        if response not in self.responses:
            raise UserError(f"unknown response {response!r}{nearest(response, self.responses)}")
        if response == "force":
            self._quantity("cross_section", "a force")
        deformation = self._deformation(excitation)
        uncertain_gauge = self._uncertain_gauge(excitation)
        record = self._record(excitation, np.asarray(coordinate, dtype=float))

        def simulate(draws: Draws) -> FloatArray:
            gauge = self._gauge(draws) if uncertain_gauge else None
            stress = self._nominal_stress(record, draws, gauge, deformation)
            if response == "force":
                stress = stress * column(self._value("cross_section", draws))
            stress[~np.all(np.isfinite(stress), axis=1)] = np.nan
            return stress

        return simulate

    def _nominal_stress(
        self, record: StripRecord, draws: Draws, gauge: FloatArray | None, deformation: str
    ) -> FloatArray:
        """Nominal stress (W, N); `gauge` (W,) scales strain and rate of each draw."""
        stretch, rate = record.stretch, record.rate
        if gauge is not None:
            stretch, rate = 1.0 + column(gauge) * (stretch - 1.0), column(gauge) * rate
        model = self.model
        stress = model.spring.nominal_stress(stretch, model.spring_draws(draws), deformation)
        if model.kelvin:
            stress += column(draws["zeta_alpha"]) * rate
        if model.units > 0:
            stress += self._unit_stress(record, draws, gauge, np.max(np.abs(stress), axis=1))
        return stress

    def _unit_stress(
        self, record: StripRecord, draws: Draws, gauge: FloatArray | None, peak: FloatArray
    ) -> FloatArray:
        """Nominal stress of all Maxwell units (W, N).

        `peak` (W,) is that of the parallel spring and dashpot: a scale of the response
        known before integration, and of this draw alone.
        """
        from deabayes.integrate.rosenbrock import LANES
        from deabayes.systems.strip_kernel import unit_stress

        modulus, time = self.model.unit_draws(draws)
        walkers = modulus.shape[1]
        lanes = np.arange(-(-walkers // LANES) * LANES) % walkers
        allowed = np.where(peak > 0.0, self.tolerance * peak, np.inf)
        limit = allowed / (self.model.units * np.abs(modulus))
        inverse = 1.0 / draws["J_beta"] if self.model.kelvin else np.zeros(walkers)
        stress = np.zeros((record.stretch.size, lanes.size))
        unit_stress(
            record.duration,
            record.grid_stretch,
            record.first_output,
            record.position,
            record.stretch[record.order],
            (np.ones(walkers) if gauge is None else gauge)[lanes],
            inverse[lanes],
            (1.0 / time)[:, lanes],
            modulus[:, lanes],
            limit[:, lanes],
            stress,
        )
        found = np.empty((walkers, record.stretch.size))
        found[:, record.order] = stress[:, :walkers].T
        return found

    def _record(self, excitation: Excitation, coordinate: FloatArray) -> StripRecord:
        """Stretch and rate at the outputs, and the steps of the integration."""
        knots, values = self._history(excitation)
        if _without_time(excitation):
            if self.model.units > 0 or self.model.kelvin:
                raise UserError(
                    f"candidate {self.candidate!r} has relaxation units and needs time; a "
                    "quasi-static record has none: take a candidate without units, such as ogden_2"
                )
            stretch = self._to_stretch(excitation.name, coordinate)
            none = np.empty(0)
            return StripRecord(stretch, np.zeros_like(stretch), none, none, none, none, none)
        before, after = np.min(coordinate) < knots[0], np.max(coordinate) > knots[-1]
        if before or knots.size == 1:
            start = min(np.min(coordinate), knots[0] - 1.0)
            knots, values = np.append(start, knots), np.append(values[0], values)
        if after:
            knots, values = np.append(knots, np.max(coordinate)), np.append(values, values[-1])
        segment = np.clip(np.searchsorted(knots, coordinate, side="right") - 1, 0, knots.size - 2)
        return StripRecord(
            np.interp(coordinate, knots, values),
            (np.diff(values) / np.diff(knots))[segment],
            *self._steps(knots, values, coordinate),
        )

    def _steps(
        self, knots: FloatArray, values: FloatArray, coordinate: FloatArray
    ) -> tuple[FloatArray, FloatArray, np.ndarray, np.ndarray, FloatArray]:
        """Grid steps with the outputs in each, finer for a smaller tolerance."""
        finer = min(1.0, self.tolerance / DEFAULT_TOLERANCE) ** 0.2
        defaults = GridSettings()
        settings = GridSettings(
            defaults.first_step * finer,
            1.0 + (defaults.growth - 1.0) * finer,
            defaults.increment * finer,
            defaults.kink * self.tolerance / DEFAULT_TOLERANCE,
        )
        kept = simplify(knots, values, 0.1 * self.tolerance * float(np.ptp(values)))
        grid = graded_grid(knots[kept], values[kept], settings)
        order = np.argsort(coordinate, kind="stable")
        ascending = coordinate[order]
        step = np.clip(np.searchsorted(grid, ascending, side="right") - 1, 0, grid.size - 2)
        duration = np.diff(grid)
        position = (ascending - grid[step]) / duration[step]
        first_output = np.searchsorted(step, np.arange(grid.size))
        stretch = np.interp(grid, knots[kept], values[kept])
        return duration, stretch, first_output, order, position

    def _history(self, excitation: Excitation) -> tuple[FloatArray, FloatArray]:
        """Knots and stretch, checked."""
        knots = np.asarray(excitation.coordinate, dtype=float)
        values = self._to_stretch(excitation.name, np.asarray(excitation.values, dtype=float))
        if not (np.all(np.isfinite(values)) and np.all(values > 0.0)):
            raise UserError(
                f"excitation {excitation.name!r}: stretch must be finite and positive, found "
                f"{np.min(values):g}; check the unit and the gauge length"
            )
        if not _without_time(excitation) and not np.all(np.diff(knots) > 0.0):
            raise UserError(
                f"excitation {excitation.name!r}: times must ascend; a jump of stretch needs a "
                "duration, and a repeated time must be removed"
            )
        return knots, values

    def _to_stretch(self, channel: str, values: FloatArray) -> FloatArray:
        if channel not in self.excitations:
            raise UserError(f"unknown excitation {channel!r}{nearest(channel, self.excitations)}")
        if channel == "stretch":
            return values
        return 1.0 + values / self._quantity("gauge_length", "a displacement").value

    def _deformation(self, excitation: Excitation) -> str:
        deformation = str(excitation.conditions.get("deformation", "uniaxial"))
        if deformation not in DEFORMATIONS:
            raise UserError(
                f"unknown deformation {deformation!r}{nearest(deformation, DEFORMATIONS)}"
            )
        if deformation != "uniaxial" and self.model.units > 0:
            raise UserError(
                f"candidate {self.candidate!r} has relaxation units, whose equations are given "
                f"for uniaxial tension only, not {deformation}: take a candidate without units"
            )
        return deformation

    def _quantity(self, name: str, purpose: str) -> Quantity:
        if name not in self.specimen.quantities:
            raise UserError(
                f"specimen {self.specimen.name!r} gives no {name}, which {purpose} needs: add it "
                f"to specimen.yaml in {self.optional_quantities[name]}"
            )
        return self.specimen.quantities[name]

    def _value(self, name: str, draws: Draws) -> FloatArray:
        """A quantity: its draws if it is a parameter, else its value, (W,) or (1,)."""
        quantity = self.specimen.quantities[name]
        return draws[name] if quantity.sd is not None else np.array([quantity.value])

    def _uncertain_gauge(self, excitation: Excitation) -> bool:
        if excitation.name != "displacement":
            return False
        return self._quantity("gauge_length", "a displacement").sd is not None

    def _gauge(self, draws: Draws) -> FloatArray:
        """Nominal gauge length over each draw's, (W,)."""
        return self.specimen.quantities["gauge_length"].value / draws["gauge_length"]


def _without_time(excitation: Excitation) -> bool:
    """Whether the knots are the excitation itself: a quasi-static record."""
    if excitation.conditions.get("protocol") == "quasi_static":
        return True
    return bool(np.array_equal(excitation.coordinate, excitation.values))


def compile_kernels() -> None:
    """Compile the strip's kernel into numba's on-disk cache."""
    from deabayes.systems.strip_kernel import unit_stress

    times, lanes = np.array([0.0, 1.0]), 32
    ones = np.ones((1, lanes))
    unit_stress(
        np.diff(times), 1.0 + times, np.array([0, 1]), times[:1], np.ones(1),
        ones[0], 0.01 * ones[0], ones, ones, ones, np.zeros((1, lanes)),
    )  # fmt: skip
