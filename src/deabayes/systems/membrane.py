r"""Membrane actuator: KV-GM under a voltage, equal-biaxial (Nguyen et al. 2021).

A Kelvin-Voigt unit alpha beside n Maxwell units beta_i, all springs Gent's; lambda the
stretch, xi_i that of dashpot i, both lambda_p (pre-stretched, relaxed) before the voltage:

    zeta_alpha lambda' = epsilon (Phi/H)^2 lambda^3 + sigma - P_alpha(lambda)
                         - sum_i mu_beta_i (lambda xi_i^-2 - lambda^-5 xi_i^4)/g_i
    xi_i' = (1/tau_i) (lambda^2 xi_i^-3 - lambda^-4 xi_i^3)/g_i
    g_i = 1 - (2 lambda^2 xi_i^-2 + lambda^-4 xi_i^4 - 3)/J_beta,   sigma = P_alpha(lambda_p)

(12)-(13), with zeta = eta/(2H) [Pa s] and tau = zeta/mu [s]; sigma is nominal. The paper's
(10) and (14) lack a factor 2 in the electrostatic term (the variation and (9), (12) have
it), and its t_v = eta/mu is no time: the relaxation time at xi = lambda is
(zeta/mu) lambda^2/6. Inertia, (14), adds (rho L^2/3) lambda'' on the left.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from deabayes.distributions import TruncatedNormal
from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.faults import UserError, nearest
from deabayes.parameter import Parameter
from deabayes.springs.base import column
from deabayes.systems.base import Derived, Draws, Simulator, System
from deabayes.systems.membrane_candidates import MembraneModel, examples
from deabayes.systems.membrane_drive import Drive, drive

DEFAULT_TOLERANCE = 1e-6
ALLOWED_ESTIMATE, ALLOWED_VARYING = 1.0, 0.15
"""Of the tolerance, per step, under constant and under varying voltage (where errors of many
steps add up); a test holds the result to the tolerance over prior draws."""
DRIVE_TOLERANCE = 0.1
"""Of the tolerance: for the voltage, relative to its peak."""
FIRST_STEP = 0.1
"""Of the time of the fastest mode."""
BREAKDOWN_STRETCH = 6.0
FOLD_POINTS = 32
SYMBOLS = {
    "permittivity": r"\varepsilon",
    "thickness": "H",
    "prestretch": r"\lambda_p",
    "side_length": "L",
    "density": r"\rho",
}
"""Quantities that become parameters where they carry an sd."""
REFERENCE_VOLTAGE = 2e3


@dataclass(frozen=True)
class PullIn:
    """Where the near equilibrium ends, each (W,).

    Attributes
    ----------
    voltage, stretch : at the end of the branch [V], [1].
    fold : whether it is a fold, hence pull-in; otherwise the branch reaches the breakdown
        stretch or the lock-up of the Gent spring.
    """

    voltage: FloatArray
    stretch: FloatArray
    fold: np.ndarray


@dataclass(frozen=True)
class Integrated:
    """Stretch (W, N); steps tried and the time at which a draw was lost, else NaN, (W,)."""

    stretch: FloatArray
    steps: np.ndarray
    ended: FloatArray


class Membrane(System):
    """A pre-stretched membrane under a voltage; stretch, displacement or area recorded.

    Parameters
    ----------
    candidate : `kv_gm_<n>`, or `kv_gm_<n>_inertia` (slow; for comparison).
    specimen : must give `thickness` H, `permittivity`, `prestretch`; `side_length` L for
        displacements and areas, `density` for inertia; `breakdown_stretch` (default 6)
        bounds the stretch.
    tolerance : error of the stretch relative to its range.
    leave_near_branch : also follow a draw past its pull-in, up to the breakdown stretch.
    """

    name = "membrane"
    protocols = ("step", "creep", "sine")
    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V"}
    responses: ClassVar[Mapping[str, str]] = {"stretch": "1", "displacement": "m", "area": "m^2"}
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

    def __init__(
        self,
        candidate: str,
        specimen: Specimen,
        tolerance: float = DEFAULT_TOLERANCE,
        leave_near_branch: bool = False,
    ) -> None:
        self.candidate = candidate
        self.specimen = specimen
        self.tolerance = tolerance
        self.leave_near_branch = leave_near_branch
        self.model = MembraneModel.from_name(candidate)
        self.order = self.model.units
        needed = ("side_length", "density") if self.model.inertia else ()
        for name in (*self.required_quantities, *needed):
            self._require(name)
        given = specimen.quantities.get("breakdown_stretch")
        self.breakdown = BREAKDOWN_STRETCH if given is None else given.value
        if not specimen.quantities["prestretch"].value < self.breakdown:
            raise UserError(
                f"specimen {specimen.name!r}: prestretch is not below breakdown_stretch "
                f"{self.breakdown:g}; give breakdown_stretch in specimen.yaml"
            )

    @classmethod
    def candidates(cls) -> list[str]:
        """Candidates that can be built."""
        return examples()

    def parameters(self) -> tuple[Parameter, ...]:
        """Material parameters, then the specimen's quantities that carry an sd and are used."""
        quantities = self.specimen.quantities
        units = {**self.required_quantities, **self.optional_quantities}
        used = [n for n in SYMBOLS if n != "density" or self.model.inertia]
        uncertain = [
            Parameter(
                name,
                SYMBOLS[name],
                units[name],
                f"{name.replace('_', ' ')} of the specimen",
                TruncatedNormal(quantities[name].value, sd, 0.0),
                quantities[name].source or "specimen.yaml",
            )
            for name in used
            if name in quantities and (sd := quantities[name].sd) is not None
        ]
        return (*self.model.parameters(), *uncertain)

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare one record; returns draws -> response (W, N).

        The voltage is linear between its knots; where knots are samples of a smooth curve,
        that curve is used (see `membrane_drive`). It is zero before its first knot, a first
        value other than zero or a repeated time is a jump, and it stays at its last value.

        A row is NaN where a draw is pulled in (its stretch passes the end of the near
        equilibrium's branch), passes the breakdown stretch, or fails.

        Raises
        ------
        UserError
            Unknown channel, missing quantity, or a voltage that is no history in time.
        """
        _check_channel("excitation", excitation.name, self.excitations)
        _check_channel("response", response, self.responses)
        if response != "stretch":
            self._require("side_length")
        coordinate = np.asarray(coordinate, dtype=float)
        order = np.argsort(coordinate, kind="stable")
        times = np.ascontiguousarray(coordinate[order])
        in_order = bool(np.all(order == np.arange(order.size)))
        history = self._drive(excitation, times)

        def simulate(draws: Draws) -> FloatArray:
            ascending = self._integrated(history, times, draws).stretch
            stretch = ascending
            if not in_order:
                stretch = np.empty_like(ascending)
                stretch[:, order] = ascending
            return self._response(stretch, response, draws)

        return simulate

    def lost(
        self, excitation: Excitation, last: float, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        """When and at which voltage a draw leaves the near branch or the validity range.

        Returns
        -------
        Time [s] (to within a step of the integration) and voltage [V], each (W,); NaN for
        draws that stay until the time `last`.
        """
        times = np.array([last])
        history = self._drive(excitation, times)
        ended = self._integrated(history, times, draws).ended
        volts = np.full(ended.shape, np.nan)
        gone = np.isfinite(ended)
        volts[gone] = history.at(ended[gone])
        return ended, volts

    def _integrated(self, history: Drive, times: FloatArray, draws: Draws) -> Integrated:
        """The draws followed through the history to the ascending `times`."""
        constants, units = self._constants(draws, history)
        walkers = len(constants)
        found = Integrated(
            np.empty((walkers, times.size)), np.empty(walkers, dtype=np.int64), np.empty(walkers)
        )
        results = found.stretch, found.steps, found.ended
        pieces = history.edges, history.coefficients, history.restart
        if self.model.inertia:
            from deabayes.systems.membrane_inertia import integrate_with_inertia

            mass = self._value("density", draws) * self._value("side_length", draws) ** 2 / 3.0
            mass = np.ascontiguousarray(np.broadcast_to(mass, walkers))
            integrate_with_inertia(*pieces, times, constants, units, mass, *results)
        else:
            from deabayes.systems.membrane_lanes import integrate

            integrate(*pieces, times, constants, units, *results)
        return found

    def pull_in(self, draws: Draws) -> PullIn:
        """Where the near equilibrium ends: the voltage a steady actuator bears."""
        from deabayes.systems.membrane_static import end_of_branch

        prestretch, inverse_limit = self._branch_arguments(draws)
        stretch, scaled, fold = end_of_branch(prestretch, inverse_limit, self.breakdown, 400)
        voltage = np.sqrt(scaled * draws["mu_alpha"] / self._gain(draws))
        return PullIn(voltage, stretch, fold > 0.0)

    def steady_stretch(self, draws: Draws, voltage: float) -> FloatArray:
        """Stretch (W,) of the near equilibrium at a voltage [V]; NaN beyond pull-in."""
        from deabayes.systems.membrane_static import near_equilibrium

        prestretch, inverse_limit = self._branch_arguments(draws)
        scaled = self._gain(draws) * voltage**2 / draws["mu_alpha"]
        scaled = np.ascontiguousarray(np.broadcast_to(scaled, prestretch.shape))
        return np.asarray(
            near_equilibrium(prestretch, inverse_limit, self.pull_in(draws).stretch, scaled)
        )

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """The paper's eta and t_v, true relaxation times, moduli, steady stretch, pull-in."""
        moduli, times = self.model.unit_draws(draws)
        total = draws["mu_alpha"] + moduli.sum(axis=1)
        twice = 2.0 * self._value("thickness", draws)
        square = self._value("prestretch", draws) ** 2
        pull_in = self.pull_in(draws)
        steady = self.steady_stretch(draws, REFERENCE_VOLTAGE)
        found = {
            "shear_modulus_total": Derived(
                r"\mu_\mathrm{total}", "Pa", "shear modulus of spring alpha and all units", total
            ),
            "eta_alpha": Derived(
                r"\eta_\alpha", "N s/m", "the paper's viscosity of dashpot alpha, 2 H zeta",
                twice * draws["zeta_alpha"],
            ),
        }  # fmt: skip
        for i, modulus, time in zip(self.model.numbers, moduli.T, times.T, strict=True):
            found[f"relaxation_time_{i}"] = Derived(
                rf"\tau_{{{i}}}(\lambda_p)", "s",
                f"linearised relaxation time of unit {i} at the pre-stretch, tau lambda_p^2/6",
                time * square / 6.0,
            )  # fmt: skip
            found[f"eta_beta_{i}"] = Derived(
                rf"\eta_{{\beta {i}}}", "N s/m", f"the paper's viscosity of unit {i}, 2 H zeta",
                twice * modulus * time,
            )  # fmt: skip
            found[f"t_v_{i}"] = Derived(
                rf"t_{{v {i}}}", "s m", f"the paper's t_v of unit {i}, eta/mu", twice * time
            )
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

    def _constants(self, draws: Draws, history: Drive) -> tuple[FloatArray, FloatArray]:
        """The kernel's constants: draws (W, 9) and units (W, n, 4); see `membrane_lanes`."""
        from deabayes.systems.membrane_static import end_of_branch

        modulus, viscosity = draws["mu_alpha"], _positive(draws["zeta_alpha"])
        moduli, times = self.model.unit_draws(draws)
        prestretch, inverse_limit = self._branch_arguments(draws)
        square = prestretch * prestretch
        gain = self._gain(draws)
        prestress, slope = _gent(prestretch, inverse_limit)
        stiffness = modulus * slope + 6.0 * moduli.sum(axis=1) / square
        fast = viscosity / stiffness
        # A range of the stretch that the draw alone tells before integration.
        scale = gain * history.peak**2 * square * prestretch / stiffness
        scale *= np.minimum(1.0, np.ptp(history.edges) / fast)
        estimate = ALLOWED_VARYING if history.varies else ALLOWED_ESTIMATE
        allowed = estimate * self.tolerance * np.where(scale > 0.0, scale, 1e-12)
        limit = np.full(modulus.shape, self.breakdown)
        if not self.leave_near_branch:
            limit = end_of_branch(prestretch, inverse_limit, self.breakdown, FOLD_POINTS)[0]
        columns = (1.0 / viscosity, modulus, inverse_limit, modulus * prestress, gain,
                   1.0 / allowed, prestretch, limit, FIRST_STEP * fast)  # fmt: skip
        constants = np.stack(np.broadcast_arrays(*columns), axis=1)
        inverse_beta = column(1.0 / _positive(draws["J_beta"]))
        weight = moduli / column(modulus + moduli.sum(axis=1))
        parts = (1.0 / _positive(times), moduli, inverse_beta, weight)
        return constants, np.stack(np.broadcast_arrays(*parts), axis=2)

    def _branch_arguments(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        """Pre-stretch and 1/J_alpha, each (W,)."""
        inverse_limit = 1.0 / _positive(draws["J_alpha"])
        prestretch = np.broadcast_to(self._value("prestretch", draws), inverse_limit.shape)
        return np.ascontiguousarray(prestretch), inverse_limit

    def _gain(self, draws: Draws) -> FloatArray:
        """epsilon/H^2 [F/m^3]: the drive per squared voltage."""
        thickness = _positive(self._value("thickness", draws))
        return np.asarray(self._value("permittivity", draws) / (thickness * thickness))

    def _response(self, stretch: FloatArray, response: str, draws: Draws) -> FloatArray:
        if response == "stretch":
            return stretch
        side = column(self._value("side_length", draws))
        if response == "displacement":
            return np.asarray(side * (stretch - column(self._value("prestretch", draws))))
        return np.asarray((side * stretch) ** 2)

    def _drive(self, excitation: Excitation, times: FloatArray) -> Drive:
        knots = np.asarray(excitation.coordinate, dtype=float)
        volts = np.asarray(excitation.values, dtype=float)
        if excitation.conditions.get("protocol") == "quasi_static" or np.array_equal(knots, volts):
            raise UserError("a membrane needs the voltage in time; a quasi-static record has none")
        if not (np.all(np.isfinite(knots)) and np.all(np.isfinite(volts))):
            raise UserError("excitation 'voltage': times and voltages must be finite")
        if np.any(np.diff(knots) < 0.0):
            raise UserError("excitation 'voltage': times must ascend; sort the record by time")
        tolerance = DRIVE_TOLERANCE * self.tolerance
        return drive(knots, volts, float(times[0]), float(times[-1]), tolerance)

    def _value(self, name: str, draws: Draws) -> FloatArray:
        """A quantity: its draws if it is a parameter, else its value, (W,) or (1,)."""
        quantity = self.specimen.quantities[name]
        if quantity.sd is not None and name in draws:
            return np.asarray(draws[name], dtype=float)
        return np.array([quantity.value])

    def _require(self, quantity: str) -> None:
        if quantity not in self.specimen.quantities:
            raise UserError(
                f"specimen {self.specimen.name!r} lacks {quantity}; "
                "add it to quantities in specimen.yaml"
            )


def _positive(values: FloatArray) -> FloatArray:
    """NaN where not positive."""
    return np.where(np.asarray(values, dtype=float) > 0.0, values, np.nan)


def _gent(stretch: FloatArray, inverse_limit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nominal stress over modulus and its slope, equal-biaxial; NaN past the limit."""
    square = stretch * stretch
    fourth = 1.0 / (square * square)
    argument = _positive(1.0 - inverse_limit * (2.0 * square + fourth - 3.0))
    force = stretch - fourth / stretch
    slope = 1.0 + 5.0 * fourth / square
    return force / argument, slope / argument + 4.0 * inverse_limit * (force / argument) ** 2


def _check_channel(kind: str, name: str, known: Mapping[str, str]) -> None:
    if name not in known:
        raise UserError(f"{kind} {name!r} is unknown for system 'membrane'{nearest(name, known)}")


def compile_kernels() -> None:
    """Compile the membrane's kernels into numba's on-disk cache."""
    from deabayes.systems.membrane_lanes import DRAW_COLUMNS, UNIT_COLUMNS, integrate
    from deabayes.systems.membrane_static import end_of_branch, near_equilibrium

    edges, volts = np.array([0.0, 1.0]), np.zeros((1, 6))
    draws, units = np.ones((1, DRAW_COLUMNS)), np.ones((1, 1, UNIT_COLUMNS))
    found, steps = np.empty((1, 1)), np.empty(1, dtype=np.int64)
    integrate(edges, volts, np.ones(1), edges[1:], draws, units, found, steps, np.empty(1))
    ones = np.ones(1)
    end_of_branch(3.0 * ones, 0.01 * ones, BREAKDOWN_STRETCH, FOLD_POINTS)
    near_equilibrium(3.0 * ones, 0.01 * ones, 4.0 * ones, 0.0 * ones)
