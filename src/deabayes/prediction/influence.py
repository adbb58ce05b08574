"""How parameters affect a response under the prior: curves and Sobol' indices."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.prior.joint import Prior
from deabayes.systems.base import System

HALF_WIDTH = 1.96
"""Half-width of a 95 % interval in standard deviations."""
RESAMPLES = 100
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILE_POINTS = 14
"""Exponent of two: marginal quantiles of the prior are computed from 2^14 points."""
REGIONS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
MOST_LEFT_OUT = 0.01
PILOT, CLEARLY_TOO_MANY = 128, 0.05
"""In each region, `PILOT` groups are tried first. The region is skipped if a larger share of them
than `CLEARLY_TOO_MANY` has a failed point. A region in which 1 % of the groups fail is skipped
wrongly once in three thousand."""
STAGES = 4
LOST = "lost"


@dataclass(frozen=True)
class Indices:
    r"""Shares of the variance of Y, each (d,), with half-widths of their 95 % intervals.

    The first-order index S_i = V[E(Y | u_i)] / V(Y) is the share that u_i alone explains. The
    total index S_Ti = E[V(Y | u_not i)] / V(Y) is the share that remains unexplained if only u_i
    is unknown (Sobol' 1993; Homma & Saltelli 1996). Estimators: Saltelli et al. 2010, Table 2,
    (b) and (f). The half-widths come from a bootstrap over the groups of the design, as if the
    groups were random. The design is more even than random points, so the half-widths are
    rather too wide.

    Attributes
    ----------
    groups, left_out : number of groups of d + 2 points in the design, and number of groups left
        out because a point failed.
    """

    first_order: FloatArray
    first_order_conf: FloatArray
    total: FloatArray
    total_conf: FloatArray
    groups: int
    left_out: int


def design(dimension: int, groups: int, rng: np.random.Generator) -> FloatArray:
    """Return Saltelli's points in the unit cube, (groups (d + 2), d).

    `groups` must be a power of two. A group holds a point A, then d copies of A, then a point B.
    Copy i takes its coordinate i from B.
    """
    from scipy.stats import qmc

    pairs = qmc.Sobol(2 * dimension, scramble=True, rng=rng).random(groups)
    a, b = pairs[:, None, :dimension], pairs[:, None, dimension:]
    mixed = np.where(np.eye(dimension, dtype=bool), b, a)
    return np.concatenate([a, mixed, b], axis=1).reshape(-1, dimension)


def indices(values: FloatArray, dimension: int, rng: np.random.Generator) -> Indices | None:
    """Compute the indices of values (n,) at a design's points; NaN marks a point that failed.

    The estimators pair the points of a group, so a group with a failed point is left out
    entirely. Without those groups the design is no longer a product design. Keep their number
    (`Indices.left_out`) small by choosing a region in which hardly any point fails.

    Returns
    -------
    None if there are fewer than two groups, or if all values are equal.
    """
    by_group = np.asarray(values, dtype=float).reshape(-1, dimension + 2)
    kept = by_group[np.all(np.isfinite(by_group), axis=1)]
    if len(kept) < 2 or np.ptp(kept) == 0.0:
        return None
    centred = (kept - kept.mean()) / kept.std()
    first, total = _estimates(centred, np.ones((1, len(kept))))
    picked = rng.integers(len(kept), size=(RESAMPLES, len(kept)))
    counts = np.array([np.bincount(row, minlength=len(kept)) for row in picked], dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):  # a resample may have equal values only
        spread = [HALF_WIDTH * e.std(axis=0, ddof=1) for e in _estimates(centred, counts)]
    left_out = len(by_group) - len(kept)
    return Indices(first[0], spread[0], total[0], spread[1], len(by_group), left_out)


def _estimates(values: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First-order and total indices (R, d) of groups (G, d + 2), counted `counts` (R, G) times."""
    a, mixed, b = values[:, :1], values[:, 1:-1], values[:, -1:]
    shares = counts / counts.sum(axis=1, keepdims=True)
    mean, square = (shares @ (0.5 * (a**power + b**power)) for power in (1, 2))
    variance = square - mean**2
    return (
        shares @ (b * (mixed - a)) / variance,
        shares @ (0.5 * (a - mixed) ** 2) / variance,
    )


@dataclass(frozen=True)
class PriorModel:
    """A candidate's response to one record's excitation, as a function of the prior's z.

    The response is computed at the coordinates `at`, by default those of the record. Parameters
    that the forward model does not have (noise) stay at z = 0.
    """

    system: System
    prior: Prior
    experiment: Experiment
    at: FloatArray | None = None

    @property
    def coordinate(self) -> FloatArray:
        """Coordinates (N,) at which the response is computed."""
        return self.experiment.coordinate if self.at is None else self.at

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the forward model's parameters, in the order of the prior."""
        known = {p.name for p in self.system.parameters()}
        return tuple(name for name in self.prior.names if name in known)

    def parameters(self, z: FloatArray) -> dict[str, FloatArray]:
        """Parameters (W,) by name at z (W, d), where d counts the forward model's parameters."""
        columns = [self.prior.names.index(name) for name in self.names]
        every = np.zeros((len(z), len(self.prior.names)))
        every[:, columns] = z
        theta = self.prior.to_parameters(every)
        return {name: theta[:, k] for name, k in zip(self.names, columns, strict=True)}

    def drawn(self, rng: np.random.Generator, count: int) -> dict[str, FloatArray]:
        """Draw parameters (count,) from the prior, by name."""
        theta = self.prior.sample(rng, count)
        return {name: theta[:, self.prior.names.index(name)] for name in self.names}

    def response(
        self, draws: Mapping[str, FloatArray], coordinate: FloatArray | None = None
    ) -> FloatArray:
        """Response (W, N) at `coordinate`, or at the model's own; rows of failed draws are NaN."""
        record = self.experiment
        at = self.coordinate if coordinate is None else coordinate
        values = self.system.predict(record.excitation, at, record.response_name, draws)
        failed = ~np.all(np.isfinite(values), axis=1)
        return np.where(failed[:, None], np.nan, values)


Stages = Callable[[PriorModel, FloatArray], Mapping[str, FloatArray]]
"""Function of the model and z (W, d): change of the response (W,) by stage; NaN if a draw fails."""


@dataclass(frozen=True)
class Curves:
    """Responses (W, N) and their parameters (W,) by name; rows of failed draws are NaN."""

    draws: Mapping[str, FloatArray]
    response: FloatArray

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each draw failed, (W,)."""
        return np.isnan(self.response[:, 0])


def prior_curves(model: PriorModel, count: int, rng: np.random.Generator) -> Curves:
    """Responses of `count` draws from the prior, including failed draws (the paper's Fig. 7)."""
    draws = model.drawn(rng, count)
    return Curves(draws, model.response(draws))


def marginal_quantiles(
    model: PriorModel, quantiles: Sequence[float] = QUANTILES
) -> dict[str, FloatArray]:
    """Quantiles (Q,) of each parameter's marginal prior, also if parameters are dependent.

    They are computed from 2^14 evenly spread points, a Sobol' sequence with stratified
    coordinates. Their error is about 1e-3 of the prior's standard deviation. If some parameters
    have another posterior as prior which is not normal in z, they are computed from 2^14 random
    draws (error 1e-2).
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
    """Vary each parameter over its prior quantiles and hold the others (Figs. 8 and 10).

    The quantiles are those of the marginal priors. If a member of an ordered group passes its
    neighbour, the relaxation units have only swapped names.

    Parameters
    ----------
    centre : values at which the other parameters are held; prior medians where not given.
    """
    moved = marginal_quantiles(model, quantiles)
    medians = {name: float(v[0]) for name, v in marginal_quantiles(model, [0.5]).items()}
    values = medians | dict(centre or {})
    curves = {}
    for name in model.names:
        draws = {n: np.full(len(quantiles), values[n]) for n in model.names} | {name: moved[name]}
        curves[name] = Curves(draws, model.response(draws))
    return curves


def stage_times(experiment: Experiment, count: int = STAGES) -> FloatArray:
    """Last `count` times 5 x 10^k s (..., 5, 50, 500 s) after the onset within the record."""
    span = float(experiment.coordinate.max()) - experiment.excitation.onset
    last = int(np.floor(np.log10(span / 5.0) + 1e-9))
    return np.asarray(5.0 * 10.0 ** np.arange(last - count + 1, last + 1))


def stage_changes(model: PriorModel, z: FloatArray, times: FloatArray) -> dict[str, FloatArray]:
    """Change of the response from the onset to each time, and between the times, (W,) each."""
    start = model.experiment.excitation.onset
    response = model.response(model.parameters(z), np.concatenate([[start], start + times]))
    change = response[:, 1:] - response[:, :1]
    labels = [f"{time:g}" for time in times]
    changes = {f"at {label} s": change[:, k] for k, label in enumerate(labels)}
    for k in range(1, len(labels)):
        changes[f"{labels[k - 1]} to {labels[k]} s"] = change[:, k] - change[:, k - 1]
    return changes


@dataclass(frozen=True)
class Sensitivity:
    """Sobol' indices by stage over a central region of the prior.

    Attributes
    ----------
    region : probability of the region in each coordinate z (0.9: from 5 to 95 %).
    runs, failed : number of model runs in the region, and number of failed runs.
    """

    region: float
    runs: int
    failed: int
    by_stage: Mapping[str, Indices]


def stage_sensitivity(
    model: PriorModel, stages: Stages, groups: int, rng: np.random.Generator
) -> Sensitivity:
    r"""Compute which parameters determine the change of the response at each stage.

    The indices refer to the independent coordinates z of the prior, one per parameter. For an
    independent parameter, its coordinate stands for the parameter. In an ordered group (built
    from its smallest member) or an inherited, correlated prior, z_k moves parameter k given the
    parameters before it. The first member's indices then include its influence on the later
    members (full effect). The last member's indices contain only its own influence once the
    others are known (independent effect; Mara & Tarantola 2012). With `ordered_from` the largest,
    the order is reversed.

    If an inherited prior is not normal in z, the normal with the same mean and covariance
    replaces it.

    Indices are not defined where draws fail. They are computed over the widest central region
    u in [(1 - r)/2, (1 + r)/2]^d, r of `REGIONS`, in which at most 1 % of the groups have a
    failed member; those groups are left out. In a narrower region, parameters with long-tailed
    priors count less.
    """
    dimension = len(model.names)
    points = design(dimension, groups, rng)
    pilot = points[: PILOT * (dimension + 2)]
    for region in REGIONS:
        if region > REGIONS[-1]:
            _, failed = _stages_in_region(model, stages, pilot, region)
            if _share_left_out(failed, dimension) > CLEARLY_TOO_MANY:
                continue
        changes, failed = _stages_in_region(model, stages, points, region)
        if _share_left_out(failed, dimension) <= MOST_LEFT_OUT:
            break
    by_stage = {
        stage: shares
        for stage, values in changes.items()
        if (shares := indices(values, dimension, rng)) is not None
    }
    return Sensitivity(region, failed.size, int(failed.sum()), by_stage)


def _stages_in_region(
    model: PriorModel, stages: Stages, points: FloatArray, region: float
) -> tuple[Mapping[str, FloatArray], NDArray[np.bool_]]:
    """Changes by stage at a design's points in a region, and which points failed."""
    from scipy.special import ndtri

    changes = stages(model, ndtri(0.5 + region * (points - 0.5)))
    return changes, np.isnan(next(iter(changes.values())))


def _share_left_out(failed: NDArray[np.bool_], dimension: int) -> float:
    """Share of a design's groups that have a failed point."""
    return float(np.mean(failed.reshape(-1, dimension + 2).any(axis=1)))


def failure_sensitivity(model: PriorModel, groups: int, rng: np.random.Generator) -> Sensitivity:
    """Indices of whether a draw fails (1) or not (0), over the whole prior."""
    from scipy.special import ndtri

    dimension = len(model.names)
    points = design(dimension, groups, rng)
    last = np.array([float(model.experiment.coordinate.max())])
    failed = np.isnan(model.response(model.parameters(ndtri(points)), last)[:, 0])
    shares = indices(failed.astype(float), dimension, rng)
    by_stage = {} if shares is None else {LOST: shares}
    return Sensitivity(1.0, failed.size, int(failed.sum()), by_stage)
