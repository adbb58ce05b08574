"""Predictions of a fitted candidate, with three separate bands and their honest limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.noise.base import NoiseModel
from deabayes.noise_origin import NoiseOrigin
from deabayes.rapidity import fastest
from deabayes.residual_scale import ResidualScale
from deabayes.systems.base import Draws, System

LEVELS = (0.5, 0.9)
LONGEST_EXTRAPOLATION = 1.5
FASTEST_EXTRAPOLATION = 1.5
RANGE_TOLERANCE = 0.01


@dataclass(frozen=True)
class Calibrated:
    """The region the calibration records span; outside it a prediction is flagged.

    `excitation` maps a channel to its lowest and highest calibrated value (SI),
    `span` a coordinate (time, stretch, ...) to the longest calibrated record; `fastest` is the
    highest frequency they tell of (see `rapidity.fastest`), NaN where that is not known.
    """

    excitation: Mapping[str, tuple[float, float]]
    span: Mapping[str, float]
    fastest: float = float("nan")

    def extrapolation(self, experiment: Experiment, values: FloatArray) -> str:
        """Say in which respects a prediction leaves the calibrated region; empty if in none.

        Parameters
        ----------
        values : of the excitation, as those in `excitation` were taken (with their sign or not).
        """
        within = self._range(experiment.excitation, values.min(), values.max())
        notes = (within, self._span(experiment), self._rate(experiment))
        return "; ".join(note for note in notes if note)

    def _range(self, excitation: Excitation, lowest: float, highest: float) -> str:
        low, high = self.excitation.get(excitation.name, (np.nan, np.nan))
        if np.isnan(low):
            return f"no calibration record was driven by {excitation.name}"
        margin = RANGE_TOLERANCE * max(abs(low), abs(high))
        if low - margin <= lowest and highest <= high + margin:
            return ""
        unit = "" if excitation.unit == "1" else f" {excitation.unit}"
        return (
            f"{excitation.name} {lowest:.4g} to {highest:.4g}{unit} lies outside the calibrated "
            f"{low:.4g} to {high:.4g}{unit}"
        )

    def _span(self, experiment: Experiment) -> str:
        span = float(np.ptp(experiment.coordinate))
        longest = self.span.get(experiment.coordinate_name, 0.0)
        if experiment.coordinate_name != "time" or span <= LONGEST_EXTRAPOLATION * longest:
            return ""
        return (
            f"{span:.4g} s is more than {LONGEST_EXTRAPOLATION} times the longest "
            f"calibration record ({longest:.4g} s)"
        )

    def _rate(self, experiment: Experiment) -> str:
        rate = fastest(experiment)
        if not rate > FASTEST_EXTRAPOLATION * self.fastest:
            return ""
        shown, calibrated = (f"{float(f'{hertz:.2g}'):g} Hz" for hertz in (rate, self.fastest))
        return (
            f"it shows what happens at up to {shown}, the calibration records at up to {calibrated}"
        )


@dataclass(frozen=True)
class Samples:
    """Samples (S, N) of the response: of the model alone, with discrepancy, with all noise.

    `log_density` (S,) is log p(y | theta_s) where the response was observed;
    `failed` counts the draws without a finite response, which are left out, and
    `failure` says why; where all failed, the samples are NaN.
    """

    parameter: FloatArray
    discrepancy: FloatArray
    predictive: FloatArray
    log_density: FloatArray | None
    failed: int
    failure: str = ""

    def band(self, samples: FloatArray) -> FloatArray:
        """Equal-tailed intervals (level, bound, N)."""
        tails = [[(1 - level) / 2, (1 + level) / 2] for level in LEVELS]
        return np.stack([np.quantile(samples, pair, axis=0) for pair in tails])


def sample_response(
    system: System,
    noise: NoiseModel,
    draws: Draws,
    noise_draws: Draws,
    experiment: Experiment,
    origin: NoiseOrigin,
    along: FloatArray,
    rng: np.random.Generator,
) -> Samples:
    """Sample what one record may read under the posterior.

    Parameters
    ----------
    noise_draws : the noise parameters of the group whose noise this record is
        taken to have, without prefix.
    origin : whose noise that is, and what it is relative to.
    along : (N,) the coordinate along which the noise is correlated, in the group's terms.
    """
    mean = system.predict(
        experiment.excitation, experiment.coordinate, experiment.response_name, draws
    )
    kept = np.all(np.isfinite(mean), axis=1)
    failure = _why_failed(system, experiment, draws, ~kept)
    if not kept.any():
        nothing = np.full((2, experiment.coordinate.size), np.nan)
        return Samples(nothing, nothing, nothing, None, kept.size, failure)
    mean = mean[kept]
    scales = origin.scales(mean)
    scale = ResidualScale(scales, origin.proportional)
    noise_draws = origin.draws({n: values[kept] for n, values in noise_draws.items()}, scales)
    weights = 1.0 / experiment.samples_averaged
    discrepancy, white = noise.sample(rng, along, weights, noise_draws)
    log_density = None
    if np.all(np.isfinite(experiment.response)):
        residuals = scale.residuals(experiment.response, mean)
        log_density = noise.log_prob(residuals, along, weights, noise_draws)
        log_density = log_density + scale.log_derivative(experiment.response).sum(axis=1)
    return Samples(
        mean,
        scale.with_residuals(mean, discrepancy),
        scale.with_residuals(mean, discrepancy + white),
        log_density,
        int(np.sum(~kept)),
        failure,
    )


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
    dimensions = ("level", "bound", "coordinate")
    unit = {"units": experiment.response_unit}
    bands = {
        name: (dimensions, samples.band(getattr(samples, name)), unit)
        for name in ("parameter", "discrepancy", "predictive")
    }
    dataset = xr.Dataset(
        {
            "observed": ("coordinate", experiment.response, unit),
            "mean": ("coordinate", samples.parameter.mean(axis=0), unit),
            "median": ("coordinate", np.median(samples.parameter, axis=0), unit),
            "excitation": (
                "coordinate",
                experiment.excitation.at(experiment.coordinate),
                {"units": experiment.excitation.unit, "long_name": experiment.excitation.name},
            ),
            **bands,
        },
        coords={
            "coordinate": (
                "coordinate",
                experiment.coordinate,
                {"name": experiment.coordinate_name, "units": experiment.coordinate_unit},
            ),
            "level": list(LEVELS),
            "bound": ["lower", "upper"],
        },
    )
    return dataset.assign_attrs(
        experiment=experiment.name,
        role=experiment.role,
        protocol=experiment.protocol,
        response_name=experiment.response_name,
        response_unit=experiment.response_unit,
        provenance=experiment.provenance,
        failed_draws=samples.failed,
        failure=samples.failure,
        **attributes,
    )
