"""Predictions of a fitted candidate with three bands: parameter, discrepancy, predictive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.inference.record_noise import ResidualScale
from deabayes.noise.base import NoiseModel
from deabayes.prediction.noise_origin import NoiseOrigin
from deabayes.prediction.outcomes import transforms
from deabayes.systems.base import Draws, System

LEVELS = (0.5, 0.9)
TAILS = tuple((0.5 - level / 2, 0.5 + level / 2) for level in LEVELS)
BANDS = ("parameter", "discrepancy", "predictive")
AT_ONCE = 2**17
"""Draws times points computed at once, so that they fit into a processor's cache."""
NEAR = 1e-8
"""Tolerance of a quantile, in standard scores."""
TRIES = 100
Cumulative = Callable[[FloatArray], FloatArray]


def bands(
    mean: FloatArray,
    scale: ResidualScale,
    noise: NoiseModel,
    noise_draws: Draws,
    weights: FloatArray,
) -> dict[str, FloatArray]:
    """Equal-tailed intervals (level, bound, N) of the model alone, with discrepancy, with noise.

    Every point is treated separately, without conditioning on readings. A wider band always
    contains the narrower one. Without this rule it might not: with few draws and little noise,
    quantiles are only as precise as the distance between draws.

    Parameters
    ----------
    mean : (S, N) curves of the draws.
    noise_draws : noise parameters by name, each (S,).
    weights : (N,) weights for the noise model, 1 / samples averaged.
    """
    shape = (len(LEVELS), 2, mean.shape[1])
    intervals = {name: np.empty(shape) for name in BANDS}
    size = max(AT_ONCE // len(mean), 1)
    for first in range(0, mean.shape[1], size):
        part = slice(first, first + size)
        curves, level = mean[:, part], scale.level(mean[:, part])
        spreads = noise.spreads(noise_draws, weights[part])
        inner = np.stack([np.quantile(curves, pair, axis=0) for pair in TAILS])
        intervals["parameter"][..., part] = inner
        for name, spread in zip(BANDS[1:], spreads, strict=True):
            if np.any(spread):
                wider = _band(level, scale.in_levels(spread), noise, noise_draws, scale)
                low = np.minimum(inner[:, 0], wider[:, 0])
                high = np.maximum(inner[:, 1], wider[:, 1])
                inner = np.stack([low, high], axis=1)
            intervals[name][..., part] = inner
    return intervals


def _band(
    level: FloatArray,
    spread: FloatArray,
    noise: NoiseModel,
    noise_draws: Draws,
    scale: ResidualScale,
) -> FloatArray:
    """Compute the intervals (level, bound, N) of some points with noise."""

    def cumulative(scores: FloatArray) -> FloatArray:
        return noise.cumulative(scores, noise_draws)

    ends = [[mixture_quantile(level, spread, p, cumulative) for p in pair] for pair in TAILS]
    return scale.response(np.array(ends))


def mixture_quantile(
    location: FloatArray, spread: FloatArray, share: float, cumulative: Cumulative
) -> FloatArray:
    """Quantile x (N,) of an equal mixture of the laws location + spread times a standard law.

    A secant search on the normal score of the share below x, which is nearly linear in x. The
    search halves its bracket at every third step, and whenever a secant leaves the bracket.

    Parameters
    ----------
    location : (S, N).
    spread : (S, N) or (S, 1); x is NaN where the spread is NaN.
    share : probability below x.
    cumulative : distribution function of the standard law, for (S, n) values.
    """
    from scipy.special import ndtri

    asked, spread = float(ndtri(share)), np.broadcast_to(spread, location.shape)
    unit = np.sqrt(location.var(axis=0) + np.mean(spread**2, axis=0))
    x = location.mean(axis=0) + asked * unit
    search = _Search(x, 1.0 / np.maximum(unit, np.finfo(float).tiny))
    for attempt in range(TRIES):
        points = search.open
        if not points.size:
            break
        below = _below(x[points], location[:, points], spread[:, points], cumulative)
        search.move(ndtri(below) - asked, halve=attempt % 3 == 2)
    return x


def _below(
    x: FloatArray, location: FloatArray, spread: FloatArray, cumulative: Cumulative
) -> FloatArray:
    """Share of the mixture below x (n,), kept away from 0 and 1."""
    with np.errstate(over="ignore"):
        scores = (x - location) / np.maximum(spread, np.finfo(float).tiny)
    return np.clip(cumulative(scores).mean(axis=0), 1e-15, 1.0 - 1e-15)


class _Search:
    """Search for the zeros of increasing functions, one per point; `x` is updated in place.

    Attributes
    ----------
    open : indices of points whose zero is not found yet.
    """

    def __init__(self, x: FloatArray, slope: FloatArray) -> None:
        self.x, self.usual, self.slope = x, slope, slope.copy()
        self.low, self.high = np.full(x.size, -np.inf), np.full(x.size, np.inf)
        self.before = np.full((2, x.size), np.nan)
        self.open = np.flatnonzero(np.isfinite(x))

    def move(self, values: FloatArray, halve: bool) -> None:
        """Move the open points to the expected zeros, given the functions' current `values`."""
        points = self.open
        x = self.x[points]
        self.low[points] = np.where(values < 0.0, x, self.low[points])
        self.high[points] = np.where(values > 0.0, x, self.high[points])
        with np.errstate(all="ignore"):
            slope = (values - self.before[1, points]) / (x - self.before[0, points])
        usable = np.isfinite(slope) & (slope > 0.0)
        self.slope[points] = np.where(usable, slope, self.usual[points])
        self.before[:, points] = x, values
        low, high = self.low[points], self.high[points]
        width = (high - low) * self.usual[points]
        unfinished = (np.abs(values) > NEAR) & (width > NEAR)
        secant = x - values / self.slope[points]
        with np.errstate(invalid="ignore"):
            middle = 0.5 * (low + high)
        use_middle = np.isfinite(middle) & (halve | (secant <= low) | (secant >= high))
        self.x[points] = np.where(unfinished, np.where(use_middle, middle, secant), x)
        self.open = points[unfinished]


@dataclass(frozen=True)
class Samples:
    """Samples (S, N) of the response: of the model alone, with discrepancy, with all noise.

    `bands` are the intervals (level, bound, N) of the three distributions. `failed` counts the
    draws without a finite response, which are left out, and `failure` says why they failed. If
    all draws failed, the samples are NaN. `log_density` is log p(y | theta_s) of every draw, -inf
    for a failed draw, or None if the response was not observed. `pit` (N,) are probability
    integral transforms (see `transforms`), NaN where unknown. `noise_note` says what a reader
    must know about the noise (see `NoiseOrigin.note_on`).
    """

    parameter: FloatArray
    discrepancy: FloatArray
    predictive: FloatArray
    bands: Mapping[str, FloatArray]
    log_density: FloatArray | None
    pit: FloatArray
    failed: int
    failure: str = ""
    noise_note: str = ""

    @classmethod
    def none(
        cls, size: int, log_density: FloatArray | None, failed: int, failure: str, note: str
    ) -> Samples:
        """Return NaN samples for a record of `size` points for which every draw failed."""
        nothing = np.full((2, size), np.nan)
        none = dict.fromkeys(BANDS, np.full((len(LEVELS), 2, size), np.nan))
        pit = np.full(size, np.nan)
        return cls(nothing, nothing, nothing, none, log_density, pit, failed, failure, note)


def sample_response(
    system: System,
    noise: NoiseModel,
    draws: Draws,
    noise_draws: Draws,
    experiment: Experiment,
    origin: NoiseOrigin,
    along: FloatArray,
    rng: np.random.Generator,
    seen: bool = False,
) -> Samples:
    """Sample the readings of one record from the posterior predictive distribution.

    Parameters
    ----------
    noise_draws : noise parameters, without prefix, of the group whose noise this record has.
    origin : which group's noise the record has, and the scale of that noise.
    along : (N,) coordinate along which the noise is correlated, stretched for that group.
    seen : whether the draws were fitted to this record.
    """
    mean = system.simulator_of(experiment)(draws)
    kept = np.all(np.isfinite(mean), axis=1)
    failure = _failure(system, experiment, draws, ~kept)
    observed = np.all(np.isfinite(experiment.response))
    log_density = np.full(kept.size, -np.inf) if observed else None
    pit = np.full(experiment.coordinate.size, np.nan)
    if not kept.any():
        return Samples.none(pit.size, log_density, kept.size, failure, origin.note)
    mean = mean[kept]
    scales = origin.scales(mean)
    scale = ResidualScale(scales, origin.proportional)
    kept_draws = {name: values[kept] for name, values in noise_draws.items()}
    noise_draws = origin.draws(noise, kept_draws, mean, scales)
    weights = 1.0 / experiment.samples_averaged
    discrepancy, white = noise.sample(rng, along, weights, noise_draws)
    if log_density is not None:
        log_density[kept], pit = _density_and_pit(
            experiment, noise, scale, mean, along, noise_draws, seen
        )
    return Samples(
        mean,
        scale.with_residuals(mean, discrepancy),
        scale.with_residuals(mean, discrepancy + white),
        bands(mean, scale, noise, noise_draws, weights),
        log_density,
        pit,
        int(np.sum(~kept)),
        failure,
        origin.note_on(mean, experiment.response_unit),
    )


def _density_and_pit(
    experiment: Experiment,
    noise: NoiseModel,
    scale: ResidualScale,
    mean: FloatArray,
    along: FloatArray,
    noise_draws: Draws,
    seen: bool,
) -> tuple[FloatArray, FloatArray]:
    """log p(y | theta_s) of the observed response, (W,), and its PIT, (N,)."""
    weights = 1.0 / experiment.samples_averaged
    residuals = scale.residuals(experiment.response, mean)
    pointwise = noise.pointwise_log_prob(residuals, along, weights, noise_draws)
    pointwise = pointwise + scale.log_derivative(experiment.response)
    total = pointwise.sum(axis=1)
    scores = noise.innovations(residuals, along, weights, noise_draws)
    pit = transforms(scores, None if seen else pointwise)
    return np.where(np.isfinite(total), total, -np.inf), pit


def _failure(
    system: System, experiment: Experiment, draws: Draws, failed: NDArray[np.bool_]
) -> str:
    """Say how many draws failed on a record, and why; empty if none failed."""
    if not failed.any():
        return ""
    lost = {name: np.ascontiguousarray(values[failed]) for name, values in draws.items()}
    note = system.failure_note(experiment.excitation, experiment.coordinate, lost)
    return f"{failed.sum()} of {failed.size} draws have no response ({note})"


def to_dataset(
    experiment: Experiment, samples: Samples, attributes: Mapping[str, object]
) -> xr.Dataset:
    """Return the dataset of one record for predictions/{experiment}.nc."""
    driven, unit = experiment.excitation, {"units": experiment.response_unit}
    driven_unit = {"units": driven.unit, "long_name": driven.name}
    along = {"name": experiment.coordinate_name, "units": experiment.coordinate_unit}
    variables: dict[str, tuple[object, ...]] = {
        "observed": ("coordinate", experiment.response, unit),
        "mean": ("coordinate", samples.parameter.mean(axis=0), unit),
        "median": ("coordinate", np.median(samples.parameter, axis=0), unit),
        "excitation": ("coordinate", driven.at(experiment.coordinate), driven_unit),
        "pit": ("coordinate", samples.pit, {"units": "1"}),
    }
    for name, band in samples.bands.items():
        variables[name] = (("level", "bound", "coordinate"), band, unit)
    coordinates = {
        "coordinate": ("coordinate", experiment.coordinate, along),
        "level": list(LEVELS),
        "bound": ["lower", "upper"],
    }
    return xr.Dataset(variables, coordinates).assign_attrs(
        experiment=experiment.name,
        role=experiment.role,
        protocol=experiment.protocol,
        response_name=experiment.response_name,
        response_unit=experiment.response_unit,
        provenance=experiment.provenance,
        failed_draws=samples.failed,
        failure=samples.failure,
        noise_note=samples.noise_note,
        step=driven.step,
        **attributes,
    )
