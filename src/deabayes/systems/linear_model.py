"""A candidate as a linear model: what its matrices take in, give out and are valid for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from deabayes.experiment import FloatArray
from deabayes.integrate.state_space import StateSpace


@dataclass(frozen=True)
class Signal:
    """An input, an output or a state."""

    name: str
    unit: str
    description: str


@dataclass(frozen=True)
class At:
    """A value of the operating point, (W,), or () where it is the same for all draws."""

    unit: str
    description: str
    values: FloatArray


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u of every draw.

    Attributes
    ----------
    space : the matrices, (W, ...).
    input, output, states : in the order of the matrices.
    validity : where the equations hold.
    operating_point : what u, x and y of a linearised model are deviations from; empty where
        the model is linear as it is.
    """

    space: StateSpace
    input: Signal
    output: Signal
    states: tuple[Signal, ...]
    validity: str
    operating_point: Mapping[str, At]
