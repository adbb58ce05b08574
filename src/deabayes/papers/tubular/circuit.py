"""Table III of the tubular actuator's paper: its circuit and the phase method."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment
from deabayes.papers import tubular as paper
from deabayes.papers.base import QUANTILES, Analysis, StudyContext, interval
from deabayes.papers.tubular.sources import Labels, circuits
from deabayes.systems.curves import frequency_of, phasor
from deabayes.systems.tubular.circuit import (
    Circuit,
    time_constant_from_phase,
    time_constant_interval,
)

SYSTEMS = ("tubular",)
TITLE = "Circuit (Table III)"
CAPTION = (
    "Series and leakage resistance, capacitance, and the time constants τe and R_S C: medians "
    "with 5 to 95 % intervals; specimen.yaml: as stated, where no candidate has a circuit; of one "
    "that is only predicted with a circuit they are the prior's. Below "
    "R_S C by the paper's phase method (15), arctan(1/(R_S C ω)) = phase by which the current of "
    "a sine leads its voltage, with what rounding the phase allows, leakage neglected. A phase "
    "near π/2 says little: the paper's 1.56 rad at 10 Hz allows 0.09 to 0.25 ms."
)


def compute(context: StudyContext) -> Analysis:
    """Return a table of circuits and a table of the phase method.

    The first has one row per circuit. The second has rows of the posteriors, the records of
    current and the paper.
    """
    import pandas as pd

    found = circuits(context, context.rng("circuit"))
    records = context.records("current", "sine")
    rows = [labels | circuit_row(circuit) for labels, circuit in found]
    compared = [row for each in records for row in phase_rows(each)]
    tables = {}
    if rows:
        tables["table_3_circuit"] = pd.DataFrame(rows)
    if compared:
        posteriors = [posterior_row(labels, circuit) for labels, circuit in found]
        tables["table_3_phase_method"] = pd.DataFrame([*posteriors, *compared, paper_row()])
    return Analysis(tables)


def circuit_row(circuit: Circuit) -> dict[str, float]:
    """Row of a circuit: R_S, R_L, C, tau_e and R_S C with their intervals."""
    series = circuit.series_resistance * circuit.capacitance
    return {
        **interval("series_resistance", "ohm", circuit.series_resistance),
        **interval("leakage_resistance", "Gohm", 1e-9 * circuit.leakage_resistance),
        **interval("capacitance", "nF", 1e9 * circuit.capacitance),
        **interval("electrical_time_constant", "ms", 1e3 * circuit.time_constant),
        **interval("series_time_constant", "ms", 1e3 * series),
    }


def posterior_row(labels: Labels, circuit: Circuit) -> dict[str, object]:
    """Row of a posterior: R_S C, and the phase of its median at the paper's frequency."""
    series = circuit.series_resistance * circuit.capacitance
    low, middle, high = np.quantile(series, [QUANTILES[0], 0.5, QUANTILES[1]])
    phase = np.arctan(1.0 / (2.0 * np.pi * paper.FREQUENCY * middle))
    return _row(str(labels["candidate"]), float(phase), middle, low, high, "5 to 95 % of the draws")


def phase_rows(experiment: Experiment) -> list[dict[str, object]]:
    """Rows of the phase method for a record of current: as measured, and rounded like the paper."""
    time = experiment.coordinate
    volts = experiment.excitation.at(time)
    frequency = frequency_of(time, volts)
    if not np.isfinite(frequency):
        return []
    current = phasor(time, experiment.response, frequency)
    phase = float(np.angle(current / phasor(time, volts, frequency)))
    rounded = paper.PHASE_RESOLUTION * round(phase / paper.PHASE_RESOLUTION)
    measured = float(time_constant_from_phase(np.asarray(phase), frequency))
    return [
        _row(f"(15), {experiment.name}", phase, measured, np.nan, np.nan, "not rounded"),
        _rounded(f"(15), {experiment.name}, rounded", rounded, frequency),
    ]


def paper_row() -> dict[str, object]:
    """Row of the phase method for the phase printed in the paper."""
    return _rounded("(15), Sarban et al. 2012", paper.PHASE, paper.FREQUENCY)


def _rounded(source: str, phase: float, frequency: float) -> dict[str, object]:
    least, most = time_constant_interval(phase, paper.PHASE_RESOLUTION, frequency)
    middle = float(time_constant_from_phase(np.asarray(phase), frequency))
    beyond = "none: the phase is beyond a quarter turn"
    bounds = beyond if np.isnan(most) else "what rounding to 0.01 rad allows"
    return _row(source, phase, middle, least, most, bounds)


def _row(
    source: str, phase: float, middle: float, low: float, high: float, bounds: str
) -> dict[str, object]:
    return {
        "source": source,
        "phase_rad": phase,
        "series_time_constant_ms": 1e3 * middle,
        "from_ms": 1e3 * low,
        "to_ms": 1e3 * high,
        "bounds": bounds,
    }
