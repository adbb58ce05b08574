"""The circuit of the tubular actuator alone: candidate `circuit`, for records of current."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.parameter import Parameter
from deabayes.systems.base import Derived, Draws, Simulator
from deabayes.systems.tubular_base import CIRCUIT_SYMBOLS, TubularBase

CANDIDATE = "circuit"


class TubularCircuit(TubularBase):
    """R_S, R_L and C by (4)-(5) of Sarban et al. (2012), without the strain they lead to.

    The response is the amplifier's current under its recorded voltage. A quantity is a
    parameter where the specimen gives it an sd; the posterior is a prior for candidates with
    `_circuit` (`prior_from`). No Kelvin unit: order 0.
    """

    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V"}
    responses: ClassVar[Mapping[str, str]] = {"current": "A"}
    proportional: ClassVar[tuple[str, ...]] = ()

    def __init__(self, candidate: str, specimen: Specimen) -> None:
        if candidate != CANDIDATE:
            raise UserError(f"candidate {candidate!r} is no circuit alone; write {CANDIDATE!r}")
        self.candidate = candidate
        self.specimen = specimen
        self.order = 0
        self.circuit, self.inertia = True, False
        for name in CIRCUIT_SYMBOLS:
            self.require(name, "a circuit")

    @classmethod
    def candidates(cls) -> tuple[str, ...]:
        return (CANDIDATE,)

    def parameters(self) -> tuple[Parameter, ...]:
        return self.uncertain(CIRCUIT_SYMBOLS)

    def check_channels(self, excitation: str, response: str) -> None:
        if excitation not in self.excitations or response not in self.responses:
            raise UserError(
                f"candidate {CANDIDATE!r} computes the response 'current' to 'voltage', not "
                f"{response!r} to {excitation!r}; leave such records out of its study"
            )

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        self.check_channels(excitation.name, response)
        return self.current_simulator(excitation, coordinate)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """The circuit's two time constants, see `Circuit.derived`."""
        return self.circuit_of(draws).derived()
