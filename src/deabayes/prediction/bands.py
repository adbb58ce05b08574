"""Predictions of a fitted candidate, with three separate bands and their honest limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.noise.base import NoiseModel
from deabayes.prediction.mixture_bands import BANDS, LEVELS, bands
from deabayes.prediction.noise_origin import NoiseOrigin
from deabayes.prediction.transforms import transforms
from deabayes.residual_scale import ResidualScale
from deabayes.systems.base import Draws, System


@dataclass(frozen=True)
class Samples:
    """Samples (S, N) of the response: of the model alone, with discrepancy, with all noise.

    `bands` are the intervals (level, bound, N) of the three, of the law that the samples are of.
    `failed` counts the draws without a finite response, which are left out, and
    `failure` says why; where all failed, the samples are NaN. `log_density` is log p(y | theta_s)
    where the response was observed, of all draws: -inf of those that failed.
    `pit` (N,) are probability integral transforms (see `transforms`), NaN where unknown.
    `noise_note` says what a reader must know of the noise (see `NoiseOrigin.note_on`).
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
        """Of a record of `size` points that no draw has a response to."""
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
    """Sample what one record may read under the posterior.

    Parameters
    ----------
    noise_draws : the noise parameters of the group whose noise this record is
        taken to have, without prefix.
    origin : whose noise that is, and what it is relative to.
    along : (N,) the coordinate along which the noise is correlated, in the group's terms.
    seen : whether the draws were fitted to this record.
    """
    mean = system.simulator_of(experiment)(draws)
    kept = np.all(np.isfinite(mean), axis=1)
    failure = _why_failed(system, experiment, draws, ~kept)
    observed = np.all(np.isfinite(experiment.response))
    log_density = np.full(kept.size, -np.inf) if observed else None
    pit = np.full(experiment.coordinate.size, np.nan)
    if not kept.any():
        return Samples.none(pit.size, log_density, kept.size, failure, origin.note)
    mean = mean[kept]
    scales = origin.scales(mean)
    scale = ResidualScale(scales, origin.proportional)
    noise_draws = origin.draws({n: values[kept] for n, values in noise_draws.items()}, scales)
    weights = 1.0 / experiment.samples_averaged
    discrepancy, white = noise.sample(rng, along, weights, noise_draws)
    if log_density is not None:
        log_density[kept], pit = _judged(experiment, noise, scale, mean, along, noise_draws, seen)
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


def _judged(
    experiment: Experiment,
    noise: NoiseModel,
    scale: ResidualScale,
    mean: FloatArray,
    along: FloatArray,
    noise_draws: Draws,
    seen: bool,
) -> tuple[FloatArray, FloatArray]:
    """log p(y | theta_s) of what was read, (W,), and its PIT, (N,)."""
    weights = 1.0 / experiment.samples_averaged
    residuals = scale.residuals(experiment.response, mean)
    each = noise.pointwise_log_prob(residuals, along, weights, noise_draws)
    each = each + scale.log_derivative(experiment.response)
    total = each.sum(axis=1)
    scores = noise.innovations(residuals, along, weights, noise_draws)
    pit = transforms(scores, None if seen else each)
    return np.where(np.isfinite(total), total, -np.inf), pit


def _why_failed(
    system: System, experiment: Experiment, draws: Draws, failed: NDArray[np.bool_]
) -> str:
    """What the system says of the draws that failed on a record; empty if none did."""
    if not failed.any():
        return ""
    lost = {name: np.ascontiguousarray(values[failed]) for name, values in draws.items()}
    note = system.failure_note(experiment.excitation, experiment.coordinate, lost)
    return f"{failed.sum()} of {failed.size} draws have no response ({note})"


def to_dataset(
    experiment: Experiment, samples: Samples, attributes: Mapping[str, object]
) -> xr.Dataset:
    """The bands of one record as they are stored in predictions/{experiment}.nc."""
    dataset = xr.Dataset(_curves(experiment, samples), _coordinates(experiment))
    return dataset.assign_attrs(
        experiment=experiment.name,
        role=experiment.role,
        protocol=experiment.protocol,
        response_name=experiment.response_name,
        response_unit=experiment.response_unit,
        provenance=experiment.provenance,
        failed_draws=samples.failed,
        failure=samples.failure,
        noise_note=samples.noise_note,
        **attributes,
    )


def _curves(experiment: Experiment, samples: Samples) -> dict[str, tuple[object, ...]]:
    driven, unit = experiment.excitation, {"units": experiment.response_unit}
    driven_unit = {"units": driven.unit, "long_name": driven.name}
    intervals = {
        name: (("level", "bound", "coordinate"), band, unit) for name, band in samples.bands.items()
    }
    return {
        "observed": ("coordinate", experiment.response, unit),
        "mean": ("coordinate", samples.parameter.mean(axis=0), unit),
        "median": ("coordinate", np.median(samples.parameter, axis=0), unit),
        "excitation": ("coordinate", driven.at(experiment.coordinate), driven_unit),
        "pit": ("coordinate", samples.pit, {"units": "1"}),
        **intervals,
    }


def _coordinates(experiment: Experiment) -> dict[str, object]:
    named = {"name": experiment.coordinate_name, "units": experiment.coordinate_unit}
    return {
        "coordinate": ("coordinate", experiment.coordinate, named),
        "level": list(LEVELS),
        "bound": ["lower", "upper"],
    }
