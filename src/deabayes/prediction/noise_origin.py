"""Which calibrated record's noise a predicted record is assumed to have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.faults import UserError
from deabayes.inference.record_noise import is_ratio
from deabayes.noise.base import NoiseModel
from deabayes.prediction.calibrated import CalibratedRecord
from deabayes.systems.base import Draws, System
from deabayes.systems.specimen_quantities import instrument

STILL = 1e-9
"""Share of a response's largest magnitude; a response that varies by less counts as constant."""


@dataclass(frozen=True)
class NoiseOrigin:
    """The noise that a record is assumed to have, and the scale that divides its residuals.

    Attributes
    ----------
    group : group of calibrated records whose noise parameters are used.
    scale : the scale that divides residuals. None means: each draw's predicted range divided by
        `calibrated_range`, since the range of a new record is not known beforehand.
    correlated_scale : unit of the correlated part's standard deviation in residuals. None means:
        each draw's predicted range.
    smallest : smallest range of a calibrated record of the group. A smaller predicted range does
        not make the noise smaller. Zero if no calibrated record has this response's unit.
    calibrated_range : mean range of the group's records, used if absolute noise of their response
        is carried over to another response; else 1.
    proportional : whether residuals are logarithms of ratios (see `ResidualScale`).
    white : standard deviation of the white noise of one raw sample, in the response's unit, if
        the sensor's stated noise replaces that of the group.
    stretch : factor on the record's coordinate before the group's correlation length applies, if
        the group's records have another coordinate.
    note : what a reader must know about the noise; empty if no noise was carried over.
    """

    group: str
    scale: float | None = 1.0
    correlated_scale: float | None = 1.0
    smallest: float = 0.0
    calibrated_range: float = 1.0
    proportional: bool = False
    stretch: float = 1.0
    white: float | None = None
    note: str = ""

    def scales(self, mean: FloatArray) -> FloatArray:
        """Scale that divides each draw's residuals, (W,); NaN where the scale is unknown."""
        if self.scale is not None:
            return np.full(mean.shape[0], self.scale)
        return self._ranges(mean) / self.calibrated_range

    def _ranges(self, mean: FloatArray) -> FloatArray:
        """Range of each draw's curve, at least `smallest`, (W,); NaN for a constant curve."""
        ranges = np.maximum(np.ptp(mean, axis=1), self.smallest)
        varies = ranges > STILL * np.max(np.abs(mean), axis=1)
        return np.where(varies, ranges, np.nan)

    def note_on(self, mean: FloatArray, unit: str) -> str:
        """Return `note`, or a note on the scale if the curves (W, N) vary too little."""
        predicted = self.scale is None or self.correlated_scale is None
        if predicted and np.median(np.ptp(mean, axis=1)) < self.smallest:
            size = f"{self.smallest:.3g}" + ("" if unit == "1" else f" {unit}")
            return (
                f"the response varies by less than in any calibrated record of {self.group}, so "
                f"its noise is in proportion to the smallest range of these records ({size})"
            )
        if predicted and np.isnan(self._ranges(mean)).any():
            return f"{self.note}; the response does not vary, so the noise's size is not known"
        return self.note

    def draws(
        self, noise: NoiseModel, noise_draws: Draws, mean: FloatArray, scales: FloatArray
    ) -> Draws:
        """Noise parameters of the group in the unit of residuals of the curves (W, N).

        The sensor's stated white noise is used if it is known.
        """
        correlated = self.correlated_scale
        noise_draws = noise.for_record(
            noise_draws, self._ranges(mean) if correlated is None else correlated
        )
        if self.white is None or "sigma_white" not in noise_draws:
            return noise_draws
        return {**noise_draws, "sigma_white": self.white / scales}


def find_noise(
    experiment: Experiment,
    records: Sequence[CalibratedRecord],
    system: System,
    noise_scale: str,
    along: str,
) -> NoiseOrigin:
    """Choose the calibrated records whose noise an experiment is assumed to have.

    A calibrated record has its own noise. Another record gets the noise of the group of a
    calibrated record with the same unit of the response. A record of the same protocol is
    preferred, and among those a record with the same coordinate. Relative noise then scales with
    each draw's predicted range, but no less than with the smallest range in the group.

    If no calibrated record has that unit, noise is carried over (see `NoiseOrigin`) from a record
    of the same protocol, else from the first record. If the chosen record has another coordinate,
    the correlation length scales with the ratio of the records' extents.

    Parameters
    ----------
    records : the calibrated records.
    noise_scale : which noise is proportional to a record's range (`noise_scale` of the study).
    along : coordinate along which the noise is correlated (`noise_coordinate`).

    Raises
    ------
    UserError
        If noise has to be carried over, and the posterior file is too old for it.
    """
    proportional = experiment.response_name in system.proportional
    for record in records:
        if record.name == experiment.name:
            return NoiseOrigin(
                record.group, record.scale, record.correlated_scale, proportional=proportional
            )
    same_unit = [
        r for r in records if system.responses[r.response_name] == experiment.response_unit
    ]
    usable = same_unit or records
    usable = [r for r in usable if r.protocol == experiment.protocol] or usable[:1]
    same_coordinate = (r for r in usable if r.coordinate_name == experiment.coordinate_name)
    source = next(same_coordinate, usable[0])
    stretch = 1.0 if along == "grid" else _stretch(experiment, source)
    if same_unit:
        if noise_scale == "absolute" or is_ratio(system, experiment.response_name):
            return NoiseOrigin(source.group, proportional=proportional, stretch=stretch)
        smallest = min(r.response_range for r in same_unit if r.group == source.group)
        relative = NoiseOrigin(source.group, correlated_scale=None, smallest=smallest)
        if noise_scale == "range":
            relative = replace(relative, scale=None, correlated_scale=1.0)
        return replace(relative, stretch=stretch)
    calibrated_range = correlated_scale = 1.0
    if noise_scale != "range" and not is_ratio(system, source.response_name):
        ranges = [r.response_range for r in records if r.group == source.group]
        calibrated_range = float(np.mean(ranges))
        correlated_scale = calibrated_range if noise_scale == "mixed" else 1.0
    carried = _carried_over(experiment, source, calibrated_range, system)
    return replace(carried, correlated_scale=correlated_scale, stretch=stretch)


def _carried_over(
    experiment: Experiment, source: CalibratedRecord, calibrated_range: float, system: System
) -> NoiseOrigin:
    """Carry over the noise of a record of another response, which has a `calibrated_range`."""
    name, unit = experiment.response_name, experiment.response_unit
    if not np.isfinite(calibrated_range):
        raise UserError(
            f"{system.candidate}: no calibrated record measured {name}, and this posterior is too "
            "old to estimate its noise from another response; fit again"
        )
    note = f"no calibrated record measured {name}: its noise is that of {source.response_name}"
    if is_ratio(system, name):
        proportional = name in system.proportional
        return NoiseOrigin(
            source.group,
            scale=1.0 / calibrated_range,
            proportional=proportional,
            note=f"{note}, as a fraction of its range" + ("" if proportional else ", in radians"),
        )
    sensor = instrument(system.specimen, "noise", name, unit)
    return NoiseOrigin(
        source.group,
        scale=None,
        calibrated_range=calibrated_range,
        white=None if sensor is None else sensor.value,
        note=f"{note}, in proportion to the response's range"
        + ("" if sensor is None else "; the white noise is that of specimen.yaml"),
    )


def _stretch(experiment: Experiment, source: CalibratedRecord) -> float:
    """Factor from an experiment's coordinate to the coordinate of the record that gives noise."""
    extent = float(np.ptp(experiment.coordinate))
    if source.coordinate_name == experiment.coordinate_name or extent == 0.0:
        return 1.0
    return source.span / extent
