"""How parameters shape a response before any data: curves and Sobol' indices."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.prior.joint import Prior
from deabayes.systems.base import System

HALF_WIDTH = 1.96
"""Of a 95 % interval, in standard deviations."""
RESAMPLES = 100


@dataclass(frozen=True)
class Indices:
    r"""Shares of the variance of Y, each (d,), with half-widths of their 95 % intervals.

    First order, S_i = V[E(Y | u_i)] / V(Y): what is explained by u_i alone; total,
    S_Ti = E[V(Y | u_not i)] / V(Y): what is left unexplained when u_i alone is unknown
    (Sobol' 1993; Homma & Saltelli 1996). Estimators: Saltelli et al. 2010, Table 2, (b)
    and (f). The half-widths bootstrap the groups of the design as if they were random;
    its points are spread more evenly than that, so they err on the wide side.

    Attributes
    ----------
    groups, left_out : groups of d + 2 points in the design, and those of them left out
        because a point failed.
    """

    first_order: FloatArray
    first_order_conf: FloatArray
    total: FloatArray
    total_conf: FloatArray
    groups: int
    left_out: int


def design(dimension: int, groups: int, rng: np.random.Generator) -> FloatArray:
    """Saltelli's points in the unit cube, (groups (d + 2), d); `groups` is a power of two.

    A group is a point A, then A with one coordinate after another from a point B, then B.
    """
    from scipy.stats import qmc

    found = qmc.Sobol(2 * dimension, scramble=True, rng=rng).random(groups)
    a, b = found[:, None, :dimension], found[:, None, dimension:]
    mixed = np.where(np.eye(dimension, dtype=bool), b, a)
    return np.concatenate([a, mixed, b], axis=1).reshape(-1, dimension)


def indices(values: FloatArray, dimension: int, rng: np.random.Generator) -> Indices | None:
    """Indices of the values (n,) at a design's points; NaN marks a point that failed.

    The estimators pair a group's points, so a group with a failed point is left out whole.
    What is left is no product design any more: keep its share small (see
    `Indices.left_out`), by asking about a region in which hardly any point fails.

    Returns
    -------
    None where there is nothing to explain: fewer than two groups, or one value throughout.
    """
    by_group = np.asarray(values, dtype=float).reshape(-1, dimension + 2)
    kept = by_group[np.all(np.isfinite(by_group), axis=1)]
    if len(kept) < 2 or np.ptp(kept) == 0.0:
        return None
    centred = (kept - kept.mean()) / kept.std()
    first, total = _estimates(centred, np.ones((1, len(kept))))
    picked = rng.integers(len(kept), size=(RESAMPLES, len(kept)))
    counts = np.array([np.bincount(row, minlength=len(kept)) for row in picked], dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a resample with one value throughout
        spread = [HALF_WIDTH * each.std(axis=0, ddof=1) for each in _estimates(centred, counts)]
    left_out = len(by_group) - len(kept)
    return Indices(first[0], spread[0], total[0], spread[1], len(by_group), left_out)


def _estimates(values: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First-order and total indices (R, d) of groups (G, d + 2), each counted so often (R, G)."""
    a, mixed, b = values[:, :1], values[:, 1:-1], values[:, -1:]
    shares = counts / counts.sum(axis=1, keepdims=True)
    mean, square = (shares @ (0.5 * (a**power + b**power)) for power in (1, 2))
    variance = square - mean**2
    return (
        shares @ (b * (mixed - a)) / variance,
        shares @ (0.5 * (a - mixed) ** 2) / variance,
    )


QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILE_POINTS = 14
"""Of two: points from which marginal quantiles of the prior are read."""
REGIONS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
MOST_LEFT_OUT = 0.01
PILOT, CLEARLY_TOO_MANY = 128, 0.05
"""Groups that are tried first in a region, and the share of them left out at which it is passed
over: by chance that happens to a region with 1 % left out once in three thousand."""
STAGES = 4
LOST = "lost"


@dataclass(frozen=True)
class PriorModel:
    """A candidate's response to one record's excitation, as a function of its prior's z.

    The response is taken at `at`, by default where the record was. Parameters of the prior
    that the forward model does not know (noise) stay at z = 0.
    """

    system: System
    prior: Prior
    experiment: Experiment
    at: FloatArray | None = None

    @property
    def coordinate(self) -> FloatArray:
        """(N,) where the response is taken."""
        return self.experiment.coordinate if self.at is None else self.at

    @property
    def names(self) -> tuple[str, ...]:
        """The forward model's parameters, in the prior's order."""
        known = {p.name for p in self.system.parameters()}
        return tuple(name for name in self.prior.names if name in known)

    def parameters(self, z: FloatArray) -> dict[str, FloatArray]:
        """Parameters (W,) by name of z (W, d), d the forward model's."""
        columns = [self.prior.names.index(name) for name in self.names]
        every = np.zeros((len(z), len(self.prior.names)))
        every[:, columns] = z
        theta = self.prior.to_parameters(every)
        return {name: theta[:, k] for name, k in zip(self.names, columns, strict=True)}

    def drawn(self, rng: np.random.Generator, count: int) -> dict[str, FloatArray]:
        """Draws (count,) of the prior itself, by name."""
        theta = self.prior.sample(rng, count)
        return {name: theta[:, self.prior.names.index(name)] for name in self.names}

    def response(
        self, draws: Mapping[str, FloatArray], coordinate: FloatArray | None = None
    ) -> FloatArray:
        """The response (W, N), there or at another coordinate; failed rows all NaN."""
        record = self.experiment
        at = self.coordinate if coordinate is None else coordinate
        values = self.system.predict(record.excitation, at, record.response_name, draws)
        failed = ~np.all(np.isfinite(values), axis=1)
        return np.where(failed[:, None], np.nan, values)


Stages = Callable[[PriorModel, FloatArray], Mapping[str, FloatArray]]
"""What the response to z (W, d) does at each stage, (W,) each; NaN where it failed."""


@dataclass(frozen=True)
class Curves:
    """Responses (W, N) and the parameters (W,) that gave them; failed draws are NaN rows."""

    draws: Mapping[str, FloatArray]
    response: FloatArray

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(W,)"""
        return np.isnan(self.response[:, 0])


def prior_curves(model: PriorModel, count: int, rng: np.random.Generator) -> Curves:
    """The response of `count` draws from the prior, failed ones kept (the paper's Fig. 7)."""
    draws = model.drawn(rng, count)
    return Curves(draws, model.response(draws))


def marginal_quantiles(
    model: PriorModel, quantiles: Sequence[float] = QUANTILES
) -> dict[str, FloatArray]:
    """Quantiles (Q,) of each parameter's marginal prior, whatever its dependence on others.

    Read from 2^14 evenly spread points (a Sobol' sequence, each coordinate of which is
    stratified), so to about 1e-3 of the prior's standard deviation; from as many draws (1e-2)
    where another posterior is the prior of some and is no normal of z.
    """
    from scipy.special import ndtri
    from scipy.stats import qmc

    size = 2**QUANTILE_POINTS
    if model.prior.is_normal_in_z:
        points = qmc.Sobol(len(model.names), scramble=False).random_base2(QUANTILE_POINTS)
        draws = model.parameters(ndtri(points + 0.5 / size))
    else:
        draws = model.drawn(np.random.default_rng(size), size)
    return {name: np.quantile(values, quantiles) for name, values in draws.items()}


def one_at_a_time(
    model: PriorModel,
    quantiles: Sequence[float] = QUANTILES,
    centre: Mapping[str, float] | None = None,
) -> dict[str, Curves]:
    """Each parameter moved over its prior's quantiles, the others held (Figs. 8 and 10).

    Values are those of the marginal priors; where a member of an ordered group passes its
    neighbour, the units have merely changed names.

    Parameters
    ----------
    centre : values at which the others are held; prior medians for those not given.
    """
    moved = marginal_quantiles(model, quantiles)
    medians = {name: float(v[0]) for name, v in marginal_quantiles(model, [0.5]).items()}
    held = medians | dict(centre or {})
    found = {}
    for name in model.names:
        draws = {n: np.full(len(quantiles), held[n]) for n in model.names} | {name: moved[name]}
        found[name] = Curves(draws, model.response(draws))
    return found


def stage_times(experiment: Experiment, count: int = STAGES) -> FloatArray:
    """Times after the onset, ..., 5, 50, 500 s: the last `count` 5 x 10^k s in the record."""
    span = float(experiment.coordinate.max()) - experiment.excitation.onset
    last = int(np.floor(np.log10(span / 5.0) + 1e-9))
    return np.asarray(5.0 * 10.0 ** np.arange(last - count + 1, last + 1))


def stage_changes(model: PriorModel, z: FloatArray, times: FloatArray) -> dict[str, FloatArray]:
    """The response's change since the onset at each time, and the creep between, (W,) each."""
    start = model.experiment.excitation.onset
    response = model.response(model.parameters(z), np.concatenate([[start], start + times]))
    change = response[:, 1:] - response[:, :1]
    labels = [f"{time:g}" for time in times]
    found = {f"at {label} s": change[:, k] for k, label in enumerate(labels)}
    for k in range(1, len(labels)):
        found[f"{labels[k - 1]} to {labels[k]} s"] = change[:, k] - change[:, k - 1]
    return found


@dataclass(frozen=True)
class Sensitivity:
    """Sobol' indices by stage over a central region of the prior.

    Attributes
    ----------
    region : probability of the region in each coordinate z (0.9: from 5 to 95 %).
    runs, failed : model runs in the region, and those that failed.
    """

    region: float
    runs: int
    failed: int
    by_stage: Mapping[str, Indices]


def stage_sensitivity(
    model: PriorModel, stages: Stages, groups: int, rng: np.random.Generator
) -> Sensitivity:
    r"""Which parameters decide what the response does at each stage.

    The indices are those of the independent coordinates z of the prior, one per
    parameter. For an independent parameter that is the parameter. Within an ordered group
    (built from its smallest member) or an inherited, correlated prior, z_k moves parameter
    k given those before it: the first member's indices include what it entails for the
    later ones (its full effect), the last member's are those left to it once the others
    are known (its independent effect; Mara & Tarantola 2012). With `ordered_from` the
    largest, the order is reversed.

    Of a prior handed on that is no normal of its z, the normal with its mean and covariance
    is taken.

    Indices are not defined where draws fail. They are taken over the widest central region
    u in [(1 - r)/2, (1 + r)/2]^d, r of `REGIONS`, in which at most 1 % of the groups have
    a failed member; those are left out. A narrower region weighs the parameters
    with long-tailed priors less.
    """
    from scipy.special import ndtri

    dimension = len(model.names)
    points = design(dimension, groups, rng)
    first = points[: PILOT * (dimension + 2)]
    for region in REGIONS:
        if region > REGIONS[-1] and _left_out(model, stages, first, region) > CLEARLY_TOO_MANY:
            continue
        reached = stages(model, ndtri(0.5 + region * (points - 0.5)))
        failed = np.isnan(next(iter(reached.values())))
        if np.mean(failed.reshape(groups, -1).any(axis=1)) <= MOST_LEFT_OUT:
            break
    found = {stage: indices(values, dimension, rng) for stage, values in reached.items()}
    by_stage = {stage: value for stage, value in found.items() if value is not None}
    return Sensitivity(region, failed.size, int(failed.sum()), by_stage)


def _left_out(model: PriorModel, stages: Stages, points: FloatArray, region: float) -> float:
    """The share of a design's groups that have a failed member in a region."""
    from scipy.special import ndtri

    reached = stages(model, ndtri(0.5 + region * (points - 0.5)))
    failed = np.isnan(next(iter(reached.values())))
    return float(np.mean(failed.reshape(-1, len(model.names) + 2).any(axis=1)))


def failure_sensitivity(model: PriorModel, groups: int, rng: np.random.Generator) -> Sensitivity:
    """Which parameters decide whether a draw fails: indices of 1 (failed) or 0, whole prior."""
    from scipy.special import ndtri

    dimension = len(model.names)
    points = design(dimension, groups, rng)
    last = np.array([float(model.experiment.coordinate.max())])
    failed = np.isnan(model.response(model.parameters(ndtri(points)), last)[:, 0])
    found = indices(failed.astype(float), dimension, rng)
    return Sensitivity(1.0, failed.size, int(failed.sum()), {} if found is None else {LOST: found})
