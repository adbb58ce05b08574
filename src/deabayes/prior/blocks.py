"""Groups of parameters that are transformed from standard normals together, and the map of all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.prior.distributions import Distribution, LogNormal
from deabayes.prior.ordered import Ordered
from deabayes.prior.parameter import Parameter
from deabayes.prior.scores import log_normal_density, log_or_nan


class Block(Protocol):
    """What `Prior` needs of a block; arrays (W, k) are its own columns."""

    @property
    def columns(self) -> tuple[int, ...]: ...

    def to_parameters(self, z: FloatArray) -> FloatArray: ...

    def to_normal(self, theta: FloatArray) -> FloatArray: ...

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Summed over the columns, (W,)."""
        ...


@dataclass(frozen=True)
class Independent:
    """Parameters of any distribution, each for itself."""

    columns: tuple[int, ...]
    distributions: tuple[Distribution, ...]

    def to_parameters(self, z: FloatArray) -> FloatArray:
        return np.column_stack([d.from_normal(z[:, k]) for k, d in enumerate(self.distributions)])

    def to_normal(self, theta: FloatArray) -> FloatArray:
        return np.column_stack([d.to_normal(theta[:, k]) for k, d in enumerate(self.distributions)])

    def log_density(self, theta: FloatArray) -> FloatArray:
        densities = (d.log_density(theta[:, k]) for k, d in enumerate(self.distributions))
        return np.sum(np.stack(list(densities)), axis=0)


@dataclass(frozen=True)
class LogNormals:
    """Log-normal parameters, all in one array operation: most parameters are."""

    columns: tuple[int, ...]
    log_medians: FloatArray
    sigmas: FloatArray

    @classmethod
    def of(cls, columns: tuple[int, ...], distributions: tuple[LogNormal, ...]) -> LogNormals:
        return cls(
            columns,
            np.log([d.median for d in distributions]),
            np.array([d.sigma for d in distributions]),
        )

    def to_parameters(self, z: FloatArray) -> FloatArray:
        return np.exp(np.clip(self.log_medians + self.sigmas * z, -700.0, 700.0))

    def to_normal(self, theta: FloatArray) -> FloatArray:
        return (log_or_nan(theta) - self.log_medians) / self.sigmas

    def log_density(self, theta: FloatArray) -> FloatArray:
        log_theta = log_or_nan(theta)
        z = (log_theta - self.log_medians) / self.sigmas
        density = log_normal_density(z) - np.log(self.sigmas) - log_theta
        return np.sum(density, axis=1)


@dataclass(frozen=True)
class Parts:
    r"""n positive parameters whose sum T has the prior, the fractions uniform on the simplex.

    z_1 gives T; the fractions are broken off a stick, f_k = v_k prod_{j<k} (1 - v_j) with
    1 - v_k = Phi(-z_{k+1})^{1/(n-k)}, k < n (Devroye 1986, XI.4), so that

    p(theta) = (n - 1)! p_T(T) / T^{n-1}.

    Records often fix a sum far better than its parts: it is then a coordinate of its own.
    """

    columns: tuple[int, ...]
    total: Distribution

    @property
    def _powers(self) -> FloatArray:
        return np.arange(len(self.columns) - 1, 0.0, -1.0)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        from scipy.special import log_ndtr

        log_steps = log_ndtr(-z[:, 1:]) / self._powers
        left = np.cumsum(log_steps, axis=1)
        before = np.concatenate([np.zeros((len(z), 1)), left], axis=1)
        broken = np.concatenate([-np.expm1(log_steps), np.ones((len(z), 1))], axis=1)
        return self.total.from_normal(z[:, 0])[:, None] * np.exp(before) * broken

    def to_normal(self, theta: FloatArray) -> FloatArray:
        from scipy.special import ndtri_exp

        theta = np.where(theta > 0.0, theta, np.nan)
        left = np.cumsum(theta[:, ::-1], axis=1)[:, ::-1]
        z = np.empty_like(theta)
        z[:, 0] = self.total.to_normal(left[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            z[:, 1:] = -ndtri_exp(np.log(left[:, 1:] / left[:, :-1]) * self._powers)
        return z

    def log_density(self, theta: FloatArray) -> FloatArray:
        total, n = theta.sum(axis=1), len(self.columns)
        found = self.total.log_density(total) + math.lgamma(n) - (n - 1) * log_or_nan(total)
        return np.where(np.all(theta > 0.0, axis=1), found, -np.inf)


def blocks_of(
    parameters: Sequence[Parameter],
    groups: Mapping[str, Sequence[int]],
    minimum_ratios: Mapping[str, float],
) -> tuple[Block, ...]:
    """The blocks of a prior's parameters.

    Parameters
    ----------
    groups : columns of the ordered ones, by the name of their group.

    Raises
    ------
    ValueError : members of a group with different priors.
    """
    blocks: list[Block] = []
    for group, members in groups.items():
        prior = parameters[members[0]].prior
        if any(parameters[k].prior != prior for k in members):
            raise ValueError(f"the members of ordered group {group} must share one prior")
        from_largest = parameters[members[0]].ordered_from == "largest"
        ratio = minimum_ratios[group]
        blocks.append(Ordered.of(group, tuple(members), prior, ratio, from_largest))
    totals = dict.fromkeys(p.part_of for p in parameters if p.part_of is not None)
    for total in totals:
        columns = tuple(k for k, p in enumerate(parameters) if p.part_of == total)
        blocks.append(Parts(columns, parameters[columns[0]].prior))
    free = [
        (k, p.prior) for k, p in enumerate(parameters) if p.ordered is None and p.part_of is None
    ]
    normals = [(k, d) for k, d in free if isinstance(d, LogNormal)]
    if normals:
        columns, medians = zip(*normals, strict=True)
        blocks.append(LogNormals.of(columns, medians))
    others = [(k, d) for k, d in free if not isinstance(d, LogNormal)]
    if others:
        blocks.append(Independent(*zip(*others, strict=True)))
    return tuple(blocks)


class DefaultMap:
    r"""theta <-> z, N(0, I), of priors that are a config's or a system's own.

    Blocks of columns are transformed together (`Block`). A parameter x with `half_product_with`
    y carries its prior on x y / 2, or, where it has `reference_stretches` l, on the stress
    x (l_1^y - l_3^y): theta times a factor, 1 for most parameters.

    Parameters
    ----------
    parameters : in the order of theta's columns.
    groups : columns of the ordered ones, by the name of their group.
    minimum_ratios : between neighbours of ordered groups.

    Raises
    ------
    UserError : a half product whose prior reaches below 0.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        groups: Mapping[str, Sequence[int]],
        minimum_ratios: Mapping[str, float],
    ) -> None:
        self._parameters = parameters
        self._half_products = _half_products(parameters)
        self.blocks = blocks_of(parameters, groups, minimum_ratios)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        """theta (W, d) of z (W, d)."""
        theta = np.empty_like(z, dtype=float)
        for block in self.blocks:
            theta[:, block.columns] = block.to_parameters(z[:, block.columns])
        with np.errstate(divide="ignore", over="ignore"):
            return theta / self._factors(theta)

    def to_normal(self, theta: FloatArray) -> FloatArray:
        """z (W, d) of theta (W, d); NaN where theta is outside the support."""
        theta = np.asarray(theta, dtype=float)
        theta = theta * self._factors(theta)
        z = np.empty_like(theta)
        for block in self.blocks:
            z[:, block.columns] = block.to_normal(theta[:, block.columns])
        return z

    def log_density(self, theta: FloatArray) -> FloatArray:
        """log p(theta), (W,), normalised; -inf or NaN outside the support."""
        factors = self._factors(theta)
        magnitudes = theta * factors
        with np.errstate(divide="ignore"):
            total = np.sum(np.log(np.abs(factors)), axis=1)
        for block in self.blocks:
            total += block.log_density(magnitudes[:, block.columns])
        return total

    def _factors(self, theta: FloatArray) -> FloatArray:
        """What theta (W, d) is multiplied by to carry the prior: 1 for most."""
        factors = np.ones_like(theta)
        for k, other in self._half_products:
            stretches = self._parameters[k].reference_stretches
            exponent = theta[:, other]
            if stretches is None:
                factors[:, k] = 0.5 * exponent
            else:
                first, third = np.log(stretches)
                factors[:, k] = np.expm1(first * exponent) - np.expm1(third * exponent)
        return factors


def _half_products(parameters: Sequence[Parameter]) -> list[tuple[int, int]]:
    """(parameter, parameter whose half product with it has the prior), as columns."""
    column = {parameter.name: k for k, parameter in enumerate(parameters)}
    found = []
    for k, parameter in enumerate(parameters):
        other = parameter.half_product_with
        if other is None:
            continue
        if other not in column:
            raise ValueError(f"{parameter.name}: half_product_with {other} is no parameter")
        if parameter.prior.support[0] < 0.0:
            raise UserError(
                f"prior of {parameter.name}: it is that of half of {parameter.name} {other}, "
                f"which is positive, so it must not reach below 0: {parameter.prior.describe()}"
            )
        found.append((k, column[other]))
    return found
