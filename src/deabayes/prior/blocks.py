"""Blocks of parameters transformed together from standard normals, and the map of all blocks."""

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
    """Interface of a block for `Prior`; arrays (W, k) hold the columns of the block."""

    @property
    def columns(self) -> tuple[int, ...]: ...

    def to_parameters(self, z: FloatArray) -> FloatArray: ...

    def to_normal(self, theta: FloatArray) -> FloatArray: ...

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Log density (W,), summed over the columns."""
        ...


@dataclass(frozen=True)
class Independent:
    """Independent parameters of any distributions."""

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
    """Independent log-normal parameters, transformed in one array operation for speed."""

    columns: tuple[int, ...]
    log_medians: FloatArray
    sigmas: FloatArray

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
    r"""n positive parameters: their sum T has the prior, their fractions are uniform.

    z_1 gives T. Stick breaking gives fractions that are uniform on the simplex,
    f_k = v_k prod_{j<k} (1 - v_j) with 1 - v_k = Phi(-z_{k+1})^{1/(n-k)}, k < n (Devroye 1986,
    XI.4), so that

    p(theta) = (n - 1)! p_T(T) / T^{n-1}.

    Records often determine a sum far better than its parts, so the sum has its own coordinate.
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
        density = self.total.log_density(total) + math.lgamma(n) - (n - 1) * log_or_nan(total)
        return np.where(np.all(theta > 0.0, axis=1), density, -np.inf)


def blocks_of(
    parameters: Sequence[Parameter],
    groups: Mapping[str, Sequence[int]],
    minimum_ratios: Mapping[str, float],
) -> tuple[Block, ...]:
    """Return the blocks of a prior's parameters.

    Parameters
    ----------
    groups : columns of the ordered parameters, by the name of their group.

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
        columns, laws = zip(*normals, strict=True)
        medians, sigmas = np.array([(law.median, law.sigma) for law in laws]).T
        blocks.append(LogNormals(columns, np.log(medians), sigmas))
    others = [(k, d) for k, d in free if not isinstance(d, LogNormal)]
    if others:
        blocks.append(Independent(*zip(*others, strict=True)))
    return tuple(blocks)


class DefaultMap:
    r"""Map between theta and z ~ N(0, I) for the priors of a config or a system.

    The columns of a block are transformed together (`Block`). For a parameter x with
    `half_product_with` y, the prior is on x y / 2. If x has `reference_stretches` l, the prior is
    on the stress x (l_1^y - l_3^y). Both are theta times a factor, which is 1 for most parameters.

    Parameters
    ----------
    parameters : in the order of theta's columns.
    groups : columns of the ordered parameters, by the name of their group.
    minimum_ratios : smallest ratio of neighbours in each ordered group.

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
        """Factors (W, d) that turn theta into the quantities that have the prior: mostly 1."""
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
    """Pairs of columns (parameter, its `half_product_with`) whose half product has the prior."""
    column = {parameter.name: k for k, parameter in enumerate(parameters)}
    pairs = []
    for k, parameter in enumerate(parameters):
        other = parameter.half_product_with
        if other is None:
            continue
        if other not in column:
            raise ValueError(f"{parameter.name}: half_product_with {other} is no parameter")
        if parameter.prior.support[0] < 0.0:
            raise UserError(
                f"prior of {parameter.name}: it is on half of {parameter.name} {other}, which is "
                f"positive, but it reaches below 0 ({parameter.prior.describe()}); use lognormal, "
                "for example"
            )
        pairs.append((k, column[other]))
    return pairs
