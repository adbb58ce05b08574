"""Base class of the physical systems: the methods that inference uses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import (
    FREQUENCY_RESPONSE,
    Excitation,
    Experiment,
    FloatArray,
    Quantity,
    Specimen,
)
from deabayes.faults import Faults, MissingQuantity, UserError, nearest
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs.stretched import StretchedSpring

if TYPE_CHECKING:
    from deabayes.prior.joint import Prior
    from deabayes.systems.ridges.film import FilmStress
    from deabayes.systems.ridges.terms import GentPair, LogParts
    from deabayes.systems.ridges.units import NestedShares, Shares, UnitHop
    from deabayes.systems.solid import LinearModel, Solid

    Ridge = FilmStress | GentPair | LogParts | NestedShares | Shares

Conditions = Mapping[str, Mapping[str, float | str | None]]
"""Excitation channel -> condition -> default where a record does not state it; None if unknown.

A condition whose default is a text must be a text; every other condition must be a number."""

TEXT, BARE = "a text", "a finite number without a unit (the one of its name, else SI)"


def condition_faults(
    system: str, known: Conditions | None, given: Mapping[str, object]
) -> list[str]:
    """Return error messages for conditions; if `known` is None, any condition name is allowed."""
    if known is None:
        return [fault for name in given for fault in _wrong(name, given[name], (BARE, TEXT))]
    defaults = {name: value for names in known.values() for name, value in names.items()}
    hint = "" if defaults else "; it has none, remove it"
    faults = [
        f"condition {name!r} is unknown for system {system!r}{hint or nearest(name, defaults)}"
        for name in given
        if name not in defaults and name != "protocol"
    ]
    for name in (name for name in given if name in defaults):
        wanted = TEXT if isinstance(defaults[name], str) else BARE
        faults += _wrong(name, given[name], (wanted,))
    return faults


def _wrong(name: str, value: object, wanted: tuple[str, ...]) -> list[str]:
    """Return an error message if a condition has a type that is not wanted, else nothing."""
    if (TEXT in wanted and isinstance(value, str)) or (BARE in wanted and _is_number(value)):
        return []
    return [f"condition {name!r} must be {' or '.join(wanted)}, found {value!r}"]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)


Draws = Mapping[str, FloatArray]
Simulator = Callable[[Draws], FloatArray]


@dataclass(frozen=True)
class Derived:
    """A quantity computed from draws: its values (W,), symbol and SI unit."""

    symbol: str
    unit: str
    description: str
    values: FloatArray


class System(ABC):
    """One physical system at one model order: a candidate.

    A system is built from a specimen and the name of a candidate. It does not depend on noise,
    on priors of noise, or on samplers.

    Attributes
    ----------
    order : number of relaxation units, or of spring terms if there are no units. A comparison
        of orders uses this number.
    """

    name: ClassVar[str]
    protocols: ClassVar[tuple[str, ...]]
    excitations: ClassVar[Mapping[str, str]]
    """Excitation channel -> SI unit."""
    in_time: ClassVar[tuple[str, ...]] = ()
    """Excitation channels that need a record with time."""
    without_time: ClassVar[tuple[str, ...]] = ()
    """Excitation channels that are not a function of time: the response is a steady state."""
    even: ClassVar[tuple[str, ...]] = ()
    """Excitation channels whose sign does not change a response, or changes only its sign."""
    conditions: ClassVar[Conditions | None] = None
    """Conditions that are constant during a record and change its response (`load_g`), by
    excitation channel. Others are refused. None if the system has no list: any is allowed."""
    responses: ClassVar[Mapping[str, str]]
    """Response channel -> SI unit."""
    zero_at_rest: ClassVar[tuple[str, ...]] = ()
    """Response channels that are zero until the excitation begins."""
    proportional: ClassVar[tuple[str, ...]] = ()
    """Response channels whose errors are proportional to the response (see `ResidualScale`)."""
    units_add: ClassVar[Literal["moduli", "compliances"] | None] = None
    """Property of the relaxation units whose sum a record shows: the moduli of units in parallel,
    or the compliances of units in series. None if a record shows neither sum."""
    required_quantities: ClassVar[Mapping[str, str]]
    """Quantity of the specimen -> SI unit."""
    optional_quantities: ClassVar[Mapping[str, str]] = {}
    meanings: ClassVar[Mapping[str, str]] = {}
    """Channel or quantity -> explanation where the name is not enough; `deabayes new` prints it."""
    headline: ClassVar[tuple[str, ...]] = ()
    """Patterns (`tau_*`) of the quantities that a reader wants first; the report begins with the
    five that match first."""

    candidate: str
    order: int
    specimen: Specimen

    @abstractmethod
    def __init__(self, candidate: str, specimen: Specimen) -> None:
        """Build the system at the order given by the name `candidate`.

        Raises
        ------
        UserError
            If the candidate is unknown, or the specimen lacks a quantity.
        """

    @classmethod
    def of(cls, candidate: str, specimen: Specimen) -> System:
        """Build the system; some classes use another class for certain candidates."""
        return cls(candidate, specimen)

    @classmethod
    @abstractmethod
    def candidates(cls) -> Sequence[str]:
        """Return the candidates, or examples of them if a name contains a number to choose."""

    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters, then the specimen's quantities that have an sd."""

    def stretched_springs(self, experiments: Sequence[Experiment]) -> tuple[StretchedSpring, ...]:
        """Return the Gent springs whose largest stretch the records show."""
        return ()

    def largest_stretches(self, experiments: Sequence[Experiment]) -> tuple[float, float] | None:
        """Return lambda_1 and lambda_3 where the records stretch a spring most, or None."""
        return None

    def coordinates(
        self, prior: Prior, experiments: Sequence[Experiment], free: frozenset[int]
    ) -> list[Ridge]:
        """Return coordinates that straighten the ridges of this system's posterior.

        Parameters
        ----------
        free : columns of the prior that are not inherited.
        """
        from deabayes.systems.ridges.terms import gent_pairs, term_shares
        from deabayes.systems.ridges.units import unit_shares

        return [
            *gent_pairs(prior, self.stretched_springs(experiments), free),
            *unit_shares(prior, experiments, self.units_add, free),
            *term_shares(prior, self.largest_stretches(experiments), free),
        ]

    def hops(self, prior: Prior, experiments: Sequence[Experiment]) -> list[UnitHop]:
        """Return proposals that jump between modes, where units or terms change their numbers."""
        from deabayes.systems.ridges.units import UnitHop

        hop = UnitHop.of(prior, self.largest_stretches(experiments))
        return [] if hop is None else [hop]

    @abstractmethod
    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare the forward model for one record.

        Returns a function of draws (name -> (W,)) that gives the response (W, N) at
        `coordinate`. A draw that fails numerically gives a row of NaN. The row of a draw does
        not depend on the other draws.
        """

    def simulator_of(self, experiment: Experiment) -> Simulator:
        """Prepare the forward model of a record, averaged as the points of the record are.

        Returns a function of draws (name -> (W,)) that gives the values to compare with the
        record, (W, N).
        """
        driven, response, nodes = experiment.excitation, experiment.response_name, experiment.nodes
        if nodes is None:
            return self.simulator(driven, experiment.coordinate, response)
        at = experiment.coordinate[nodes.point] + nodes.offsets
        distinct, places = np.unique(at, return_inverse=True)
        simulate = self.simulator(driven, distinct, response)
        starts, shares = nodes.starts, nodes.shares

        def averaged(draws: Draws) -> FloatArray:
            return np.add.reduceat(simulate(draws)[:, places] * shares, starts, axis=1)

        return averaged

    @property
    def time_scale(self) -> float:
        """Time parameter of a relaxation unit divided by its relaxation time at rest."""
        return 1.0

    @property
    def massless(self) -> bool:
        """Whether the candidate has no mass, so that it cannot resonate."""
        return False

    def for_likelihood(self, rough: bool = False) -> System:
        """Return the model, solved as accurately as a likelihood needs; a fast model is unchanged.

        Parameters
        ----------
        rough : whether the draws are made before the actual sampling and then discarded.
        """
        return self

    def log_likelihood_of_quantities(self, draws: Draws) -> FloatArray:
        """Log-likelihood of measured quantities of the specimen that the model computes, (W,)."""
        return np.zeros(next(iter(draws.values())).shape)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return quantities that the papers report, computed from draws."""
        return {}

    def linear_model(
        self, draws: Draws, load: float = 0.0, bias: float | None = None
    ) -> LinearModel | None:
        """Return the state space of every draw, for control; None if the system has none.

        Parameters
        ----------
        draws : name -> (W,).
        load : mass of the hanging load [kg].
        bias : voltage [V] to linearise about; None for the model that is linear without a bias.

        Raises
        ------
        UserError
            If there is a load, but the candidate has no mass to add it to.
        """
        return None

    def solid(self, draws: Draws) -> Solid | None:
        """Return the material of every draw for finite elements; None if the system has none."""
        return None

    def response_to(self, excitation: str) -> str:
        """Return the default response to an excitation channel.

        Raises
        ------
        UserError : a frequency response, because only the name distinguishes gain and phase.
        """
        named = [name for name in self.responses if name in FREQUENCY_RESPONSE]
        if excitation in FREQUENCY_RESPONSE and named:
            raise UserError(
                f"excitation {excitation!r}: no response is named; give --response "
                f"{' or '.join(named)} (`deabayes predict`), in Python response={named[0]!r}"
            )
        return next(iter(self.responses))

    def why_failed(self, draws: Draws) -> NDArray[np.str_]:
        """Return a short reason for each failed draw (W,)."""
        return np.full(next(iter(draws.values())).shape, "no finite response")

    def failure_note(self, excitation: Excitation, coordinate: FloatArray, draws: Draws) -> str:
        """Return the reasons why these draws (W,) failed on a record, with their counts."""
        words, counts = np.unique(self.why_failed(draws), return_counts=True)
        if counts.sum() == 1:
            return str(words[0])
        order = np.argsort(-counts)
        return ", ".join(f"{counts[k]} × {words[k]}" for k in order)

    def cautions(self, experiment: Experiment) -> tuple[str, ...]:
        """Return warnings about a record that follow from the specimen's quantities."""
        return ()

    def predict(
        self, excitation: Excitation, coordinate: FloatArray, response: str, draws: Draws
    ) -> FloatArray:
        """Return the response (W, N): `simulator(...)(draws)`."""
        return self.simulator(excitation, coordinate, response)(draws)

    def stated(self) -> Mapping[str, Quantity]:
        """Return the specimen's quantities, and quantities that the system computes from them."""
        return self.specimen.quantities

    def require(self, quantity: str, purpose: str = "") -> Quantity:
        """Return a quantity that the specimen must give, always or for this purpose.

        Raises
        ------
        MissingQuantity
        """
        if quantity not in self.specimen.quantities:
            unit = {**self.required_quantities, **self.optional_quantities}[quantity]
            raise MissingQuantity(self.specimen.name, quantity, unit, purpose)
        return self.specimen.quantities[quantity]

    def check_conditions(self, given: Mapping[str, object]) -> None:
        """Refuse conditions that this system does not have, and values of the wrong type.

        Raises
        ------
        Faults
        """
        faults = condition_faults(self.name, self.conditions, given)
        if faults:
            raise Faults(faults)

    def check_channels(self, excitation: str, response: str) -> None:
        """Refuse an excitation or a response that this system does not have.

        Raises
        ------
        UserError
        """
        asked = (("excitation", excitation, self.excitations),
                 ("response", response, self.responses))  # fmt: skip
        for kind, name, known in asked:
            if name not in known:
                raise UserError(
                    f"{kind} {name!r} is unknown for system {self.name!r}{nearest(name, known)}"
                )
        if (excitation in FREQUENCY_RESPONSE) != (response in FREQUENCY_RESPONSE):
            raise UserError(
                f"response {response!r} does not go with excitation {excitation!r}: a frequency "
                "response has excitation 'frequency' and response 'gain' or 'phase'"
            )


Result = TypeVar("Result")


class Batch(Mapping[str, FloatArray]):
    """Unchanging draws by parameter name, with stored results that systems computed from them."""

    def __init__(self, draws: Draws) -> None:
        self._draws = dict(draws)
        self.results: dict[Hashable, Any] = {}

    def __getitem__(self, name: str) -> FloatArray:
        return self._draws[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._draws)

    def __len__(self) -> int:
        return len(self._draws)


def cached(draws: Draws, key: Hashable, compute: Callable[[], Result]) -> Result:
    """Return the result of `compute`; for a `Batch` the result is computed once and stored."""
    if not isinstance(draws, Batch):
        return compute()
    if key not in draws.results:
        draws.results[key] = compute()
    result: Result = draws.results[key]
    return result


class UnknownCandidate(UserError):
    """Error for an unknown candidate; `systems.build` checks whether another system has it."""
