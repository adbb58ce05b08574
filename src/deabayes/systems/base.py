"""What every physical system offers to inference."""

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
"""Excitation channel -> condition -> its value where a record states none; None if not known.

A condition is a text where that value is one, and else a number."""

TEXT, BARE = "a text", "a finite number without a unit (the one of its name, else SI)"


def condition_faults(
    system: str, told: Conditions | None, given: Mapping[str, object]
) -> list[str]:
    """What is wrong with conditions; a system that tells none (`told` None) may have any."""
    unstated = {name: held for names in (told or {}).values() for name, held in names.items()}
    if told is None:
        return [fault for name in given for fault in _wrong(name, given[name], (BARE, TEXT))]
    hint = "" if unstated else "; it has none, remove it"
    faults = [
        f"condition {name!r} is unknown for system {system!r}{hint or nearest(name, unstated)}"
        for name in given
        if name not in unstated and name != "protocol"
    ]
    for name in (each for each in given if each in unstated):
        wanted = TEXT if isinstance(unstated[name], str) else BARE
        faults += _wrong(name, given[name], (wanted,))
    return faults


def _wrong(name: str, value: object, wanted: tuple[str, ...]) -> list[str]:
    """What is said of a value that is nothing of what is wanted."""
    if (TEXT in wanted and isinstance(value, str)) or (BARE in wanted and _is_number(value)):
        return []
    return [f"condition {name!r} must be {' or '.join(wanted)}, found {value!r}"]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)


Draws = Mapping[str, FloatArray]
Simulator = Callable[[Draws], FloatArray]


@dataclass(frozen=True)
class Derived:
    """A quantity computed from draws: values (W,), with its symbol and SI unit."""

    symbol: str
    unit: str
    description: str
    values: FloatArray


class System(ABC):
    """One physical system at one model order: a candidate.

    A system is built from a specimen and a candidate's name, and knows nothing
    of noise, priors on noise, or samplers.

    Attributes
    ----------
    order : number of relaxation units (or of spring terms when there are none):
        what an order comparison counts.
    """

    name: ClassVar[str]
    protocols: ClassVar[tuple[str, ...]]
    excitations: ClassVar[Mapping[str, str]]
    """Excitation channel -> SI unit."""
    in_time: ClassVar[tuple[str, ...]] = ()
    """Excitation channels that drive nothing without time."""
    without_time: ClassVar[tuple[str, ...]] = ()
    """Excitation channels that are no function of time: responses are those of a steady state."""
    even: ClassVar[tuple[str, ...]] = ()
    """Excitation channels whose sign makes no difference to a response, or only turns its sign."""
    conditions: ClassVar[Conditions | None] = None
    """What is held during a record and its response depends on (`load_g`), by excitation: compared
    with the calibrated, and others refused; None where it is not told."""
    responses: ClassVar[Mapping[str, str]]
    """Response channel -> SI unit."""
    zero_at_rest: ClassVar[tuple[str, ...]] = ()
    """Response channels that are zero until the excitation begins."""
    proportional: ClassVar[tuple[str, ...]] = ()
    """Response channels whose errors are in proportion to the response (see `ResidualScale`)."""
    units_add: ClassVar[Literal["moduli", "compliances"] | None] = None
    """What of relaxation units a record shows the sum of: of those in parallel the moduli, of those
    in series the compliances; None where it is neither."""
    required_quantities: ClassVar[Mapping[str, str]]
    """Quantity of the specimen -> SI unit."""
    optional_quantities: ClassVar[Mapping[str, str]] = {}
    meanings: ClassVar[Mapping[str, str]] = {}
    """Channel or quantity -> what it is where the name leaves that open; `deabayes new` says it."""

    candidate: str
    order: int
    specimen: Specimen

    @abstractmethod
    def __init__(self, candidate: str, specimen: Specimen) -> None:
        """Build the system at the order that `candidate` names.

        Raises
        ------
        UserError
            If the candidate is unknown, or the specimen lacks a quantity.
        """

    @classmethod
    def of(cls, candidate: str, specimen: Specimen) -> System:
        """Build the system; a class may leave candidates of another kind to another class."""
        return cls(candidate, specimen)

    @classmethod
    @abstractmethod
    def candidates(cls) -> Sequence[str]:
        """Candidates that can be built (examples, where a name has free numbers)."""

    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Material parameters, then the specimen's quantities that carry an sd."""

    def stretched_springs(self, experiments: Sequence[Experiment]) -> tuple[StretchedSpring, ...]:
        """Gent springs that all records together are known to have stretched."""
        return ()

    def largest_stretches(self, experiments: Sequence[Experiment]) -> tuple[float, float] | None:
        """lambda_1 and lambda_3 where records stretch a spring most, if that is known."""
        return None

    def coordinates(
        self, prior: Prior, experiments: Sequence[Experiment], free: frozenset[int]
    ) -> list[Ridge]:
        """Coordinates in which what records show of this system is straight.

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
        """Proposals between modes: units or terms numbered in another way."""
        from deabayes.systems.ridges.units import UnitHop

        hop = UnitHop.of(prior, self.largest_stretches(experiments))
        return [] if hop is None else [hop]

    @abstractmethod
    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        """Prepare the forward model for one record.

        Returns a function of draws (name -> (W,)) giving the response (W, N) at
        `coordinate`. A draw that fails numerically gives a row of NaN; no draw
        changes another's row.
        """

    def simulator_of(self, experiment: Experiment) -> Simulator:
        """The forward model of a record: the mean over the samples behind each point.

        Returns a function of draws (name -> (W,)) giving what is compared with the record, (W, N).
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
        """Times the time in which a relaxation unit relaxes at rest: its time parameter."""
        return 1.0

    @property
    def massless(self) -> bool:
        """Whether nothing of it is known to resonate, as the candidate leaves all mass out."""
        return False

    def for_likelihood(self, rough: bool = False) -> System:
        """The same model, solved only as accurately as a likelihood needs; itself unless slow.

        Parameters
        ----------
        rough : for draws that are dropped, before sampling proper.
        """
        return self

    def log_likelihood_of_quantities(self, draws: Draws) -> FloatArray:
        """log p of what was measured on the specimen and the model derives, (W,)."""
        return np.zeros(next(iter(draws.values())).shape)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Quantities in the papers' terms, computed from draws."""
        return {}

    def linear_model(
        self, draws: Draws, load: float = 0.0, bias: float | None = None
    ) -> LinearModel | None:
        """The state space of every draw, for control; None if the system is not linear.

        Parameters
        ----------
        draws : name -> (W,).
        load : the hung mass [kg].
        bias : the voltage [V] to linearise about; None for what is linear as it is.

        Raises
        ------
        UserError
            If the candidate has no mass to which the load could be added.
        """
        return None

    def solid(self, draws: Draws) -> Solid | None:
        """What the specimen is made of, of every draw, for finite elements; None if not told."""
        return None

    def response_to(self, excitation: str) -> str:
        """The response to an excitation channel where none is named.

        Raises
        ------
        UserError : a frequency response, of which gain and phase are told apart by name alone.
        """
        named = [name for name in self.responses if name in FREQUENCY_RESPONSE]
        if excitation in FREQUENCY_RESPONSE and named:
            raise UserError(
                f"excitation {excitation!r}: no response is named; give --response "
                f"{' or '.join(named)} (`deabayes predict`), in Python response={named[0]!r}"
            )
        return next(iter(self.responses))

    def why_failed(self, draws: Draws) -> NDArray[np.str_]:
        """In a few words, why each of these draws (W,), which failed, has no response."""
        return np.full(next(iter(draws.values())).shape, "no finite response")

    def failure_note(self, excitation: Excitation, coordinate: FloatArray, draws: Draws) -> str:
        """Say why these draws (W,), which failed on a record, have no response."""
        words, counts = np.unique(self.why_failed(draws), return_counts=True)
        if counts.sum() == 1:
            return str(words[0])
        order = np.argsort(-counts)
        return ", ".join(f"{counts[k]} × {words[k]}" for k in order)

    def cautions(self, experiment: Experiment) -> tuple[str, ...]:
        """What to know before trusting a record, as far as the specimen's quantities tell."""
        return ()

    def predict(
        self, excitation: Excitation, coordinate: FloatArray, response: str, draws: Draws
    ) -> FloatArray:
        """`simulator(...)(draws)`: the response (W, N)."""
        return self.simulator(excitation, coordinate, response)(draws)

    def stated(self) -> Mapping[str, Quantity]:
        """The specimen's quantities, and those that the system makes of them."""
        return self.specimen.quantities

    def require(self, quantity: str, purpose: str = "") -> Quantity:
        """A quantity that the specimen must give, for all purposes or for this one.

        Raises
        ------
        MissingQuantity
        """
        if quantity not in self.specimen.quantities:
            unit = {**self.required_quantities, **self.optional_quantities}[quantity]
            raise MissingQuantity(self.specimen.name, quantity, unit, purpose)
        return self.specimen.quantities[quantity]

    def check_conditions(self, given: Mapping[str, object]) -> None:
        """Refuse conditions that no response of this system depends on, and values that are none.

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


Made = TypeVar("Made")


class Batch(Mapping[str, FloatArray]):
    """Draws by parameter name that stay as they are, and what systems have made of them."""

    def __init__(self, draws: Draws) -> None:
        self._draws = dict(draws)
        self.made: dict[Hashable, Any] = {}

    def __getitem__(self, name: str) -> FloatArray:
        return self._draws[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._draws)

    def __len__(self) -> int:
        return len(self._draws)


def once(draws: Draws, key: Hashable, make: Callable[[], Made]) -> Made:
    """What `make` gives: for a `Batch` made once, however many records ask for it."""
    if not isinstance(draws, Batch):
        return make()
    if key not in draws.made:
        draws.made[key] = make()
    found: Made = draws.made[key]
    return found


class UnknownCandidate(UserError):
    """Raised by a system; `systems.build` knows whether it is another one's."""
