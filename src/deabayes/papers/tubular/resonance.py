"""Table IV of the tubular actuator's paper: errors of resonance frequency and amplitude."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.papers.base import Analysis, StudyContext, interval, labels
from deabayes.systems.tubular.system import Tubular

SYSTEMS = ("tubular",)
TITLE = "Resonance (Table IV)"
CAPTION = (
    "Frequency and gain of the greatest gain of each frequency response: measured (a parabola in "
    "the squared frequency through 1/gain² near the peak, which one damped mass on a spring has "
    "exactly), predicted by the continuous curve of each draw, and the error (predicted − "
    "measured) / measured, each with the 5 to 95 % "
    "interval of the draws. The measured peak's own uncertainty is not in the interval. A "
    "candidate fitted without mass is predicted with it (predict_with). The paper's Table IV did "
    "not survive in its text."
)
NEAR_PEAK = 0.6
"""Points above this share of the largest gain are used to fit the peak."""
FEWEST_POINTS = 5
PERCENT = 100.0


def compute(context: StudyContext) -> Analysis:
    """Return one row per measured gain and candidate whose model has mass."""
    rows = []
    for name, fitted in context.candidates.items():
        for record in context.records("gain", "frequency_response"):
            system = fitted.system_for(record)
            if isinstance(system, Tubular) and system.inertia:
                first = labels(name, fitted) | {"experiment": record.name, "role": record.role}
                first["load_g"] = record.metadata.get("load_g")
                rows.append(first | errors(record, system, fitted.draws))
    return Analysis.of_rows({"table_4_resonance": rows})


def errors(
    experiment: Experiment, system: Tubular, draws: Mapping[str, FloatArray]
) -> dict[str, float]:
    """Measured and predicted peak, and errors E(f_n) and E(A_n) in percent."""
    measured = measured_peak(experiment.coordinate, experiment.response)
    predicted = system.harmonic(experiment.excitation, draws).peak()
    row: dict[str, float] = {}
    kinds = (("frequency", "Hz", 1.0), ("gain", "percentperV", PERCENT))
    for (name, unit, factor), of_record, of_draws in zip(kinds, measured, predicted, strict=True):
        row[f"measured_{name}_{unit}"] = factor * of_record
        row |= interval(f"predicted_{name}", unit, factor * of_draws)
        row |= interval(f"{name}_error", "percent", PERCENT * (of_draws / of_record - 1.0))
    return row


def measured_peak(frequency: FloatArray, gain: FloatArray) -> tuple[float, float]:
    """Frequency [Hz] and gain of the peak between the points (F,), by least squares.

    1/gain^2 of a damped mass on a spring is a parabola in f^2. The weights correspond to equal
    relative errors of the gains. NaN if the largest gain is at the first or last point, because
    then no peak was measured.
    """
    top = int(np.argmax(gain))
    if top in (0, gain.size - 1):
        return np.nan, np.nan
    below = np.flatnonzero(gain < NEAR_PEAK * gain[top])
    first = max(below[below < top], default=-1) + 1
    last = min(below[below > top], default=gain.size) - 1
    half = FEWEST_POINTS // 2
    near = slice(max(min(first, top - half), 0), min(max(last, top + half), gain.size - 1) + 1)
    square, centre, largest = frequency[near] ** 2, frequency[top] ** 2, gain[top]
    relative = gain[near] / largest
    bend, slope, height = np.polyfit(square / centre - 1.0, relative**-2, 2, w=relative**2)
    place, least = 1.0 - 0.5 * slope / bend, height - 0.25 * slope**2 / bend
    if bend <= 0.0 or least <= 0.0 or place <= 0.0:
        return np.nan, np.nan
    return float(np.sqrt(centre * place)), float(largest / np.sqrt(least))
