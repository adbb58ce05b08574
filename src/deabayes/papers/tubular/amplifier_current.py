"""Whether the amplifier can supply the current that records need: (16) of Sarban et al."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment
from deabayes.papers.base import Analysis, Row, StudyContext, interval
from deabayes.papers.timing import STEPS, amplitude
from deabayes.papers.tubular.sources import circuits
from deabayes.systems.curves import drive_of
from deabayes.systems.specimen_quantities import instrument
from deabayes.systems.tubular.circuit import Circuit

SYSTEMS = ("tubular",)
TITLE = "Amplifier current (16)"
CAPTION = (
    "Amplitude of the current of each sine, ωCV/√(1 + (ωR_S C)²), at the highest frequency of a "
    "frequency response, against the amplifier's limit; for how long a step keeps the amplifier "
    "at its limit, (V − R_S I)C/I. Medians with 5 to 95 % intervals of the draws. Above its limit "
    "the amplifier distorts a sine; a step is none on the scale of the time at the limit."
)
UNDER, OVER = "under the limit", "over the limit: the voltage is distorted"
CERTAIN = 0.95
"""Share of the draws that must agree for a verdict."""


def compute(context: StudyContext) -> Analysis:
    """Return one row per circuit and record that is driven by a sine or a step."""
    limit = instrument(context.specimen, "current_limit", "current", "A")
    if limit is None:
        return Analysis()
    rows = [
        first | row
        for first, circuit in circuits(context, context.rng("amplifier_current"))
        for record in context.experiments
        for row in rows_of(record, circuit, limit.value)
    ]
    return Analysis.of_rows({"amplifier_current": rows})


def rows_of(experiment: Experiment, circuit: Circuit, limit: float) -> list[Row]:
    """Current that a record needs from the amplifier: one row, or none."""
    first: Row = {"experiment": experiment.name, "protocol": experiment.protocol}
    if experiment.protocol in STEPS:
        return [first | step_row(amplitude(experiment.excitation), circuit, limit)]
    # phase and gain are from the same sweep
    drive = None if experiment.response_name == "phase" else drive_of(experiment)
    return [] if drive is None else [first | sine_row(*drive, circuit, limit)]


def sine_row(volts: float, frequency: float, circuit: Circuit, limit: float) -> Row:
    """Row of a sine of amplitude `volts` [V]."""
    current = circuit.current_amplitude(volts, np.array([frequency]))[:, 0]
    over = float(np.mean(current > limit))
    verdict = f"over the limit in {100.0 * over:.0f} % of the draws"
    if over <= 1.0 - CERTAIN:
        verdict = UNDER
    elif over >= CERTAIN:
        verdict = OVER
    return {
        "voltage_kV": volts / 1e3,
        "frequency_Hz": frequency,
        **interval("current", "mA", 1e3 * current),
        "limit_mA": 1e3 * limit,
        **interval("at_limit", "ms", []),
        "verdict": verdict,
    }


def step_row(volts: float, circuit: Circuit, limit: float) -> Row:
    """Row of a step from zero to `volts` [V].

    v_C rises at I/C until v_C + R_S I equals the command.
    """
    left = volts - circuit.series_resistance * limit
    duration = np.maximum(left, 0.0) * circuit.capacitance / limit
    at_limit = float(np.median(duration)) > 0.0
    return {
        "voltage_kV": volts / 1e3,
        "frequency_Hz": np.nan,
        **interval("current", "mA", []),
        "limit_mA": 1e3 * limit,
        **interval("at_limit", "ms", 1e3 * duration),
        "verdict": "at the limit at first: no step on that scale" if at_limit else UNDER,
    }
