"""What parameters do to the first and the last whole cycle of a sine, from the prior alone."""

from __future__ import annotations

from dataclasses import replace

from deabayes.analyses.drive import Cycles
from deabayes.analyses.loops import PHASES, Loops
from deabayes.experiment import Experiment, FloatArray
from deabayes.prediction.influence import PriorModel

FEWEST = 2
"""Whole cycles: creep shows between the first and the last."""
FIRST, LAST = 0, -1


def has_cycles(record: Experiment) -> bool:
    """Whether the record is a sine with enough whole cycles."""
    return record.protocol == "sine" and Cycles.of(record).starts.size >= FEWEST


def cycle_numbers(record: Experiment) -> tuple[int, int]:
    """The first and the last whole cycle, counted from 1."""
    first, last = Cycles.of(record).numbers[[FIRST, LAST]].tolist()
    return first, last


def over_cycles(model: PriorModel) -> PriorModel:
    """The model with its response taken at even phases of the first and the last whole cycle."""
    return replace(model, at=_times(model.experiment).ravel())


def loops(record: Experiment, response: FloatArray) -> Loops:
    """The two cycles' loops of responses (..., N) taken `over_cycles`."""
    times = _times(record)
    shape = *response.shape[:-1], *times.shape
    return Loops(response.reshape(shape), record.excitation.at(times))


def cycle_stages(model: PriorModel, z: FloatArray) -> dict[str, FloatArray]:
    """Amplitude of the first and the last whole cycle, creep between, hysteresis; (W,) each."""
    found = loops(model.experiment, over_cycles(model).response(model.parameters(z)))
    first, last = cycle_numbers(model.experiment)
    mean, size = found.mean, found.peak_to_peak
    return {
        f"peak to peak, cycle {first}": size[:, FIRST],
        f"peak to peak, cycle {last}": size[:, LAST],
        f"drift of the mean, {first} to {last}": mean[:, LAST] - mean[:, FIRST],
        f"loop area, cycle {last}": found.area[:, LAST],
    }


def _times(record: Experiment) -> FloatArray:
    return Cycles.of(record).times(PHASES)[[FIRST, LAST]]
