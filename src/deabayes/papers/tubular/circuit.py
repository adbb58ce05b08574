"""Table III of the tubular actuator's paper: its circuit and the phase method."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment
from deabayes.papers import tubular as paper
from deabayes.papers.base import Analysis, Row, StudyContext, band, interval
from deabayes.papers.tubular.sources import circuits
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
    drawn = circuits(context, context.rng("circuit"))
    by_phase = [row for record in context.records("current", "sine") for row in phase_rows(record)]
    if by_phase:
        of_posteriors = [
            posterior_row(str(first["candidate"]), circuit) for first, circuit in drawn
        ]
        by_phase = [*of_posteriors, *by_phase, paper_row()]
    return Analysis.of_rows(
        {
            "table_3_circuit": [first | circuit_row(circuit) for first, circuit in drawn],
            "table_3_phase_method": by_phase,
        }
    )


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


def posterior_row(candidate: str, circuit: Circuit) -> Row:
    """Row of a posterior: R_S C, and the phase of its median at the paper's frequency."""
    low, middle, high = band(circuit.series_resistance * circuit.capacitance)
    phase = np.arctan(1.0 / (2.0 * np.pi * paper.FREQUENCY * middle))
    return _row(candidate, float(phase), middle, (low, high), "5 to 95 % of the draws")


def phase_rows(experiment: Experiment) -> list[Row]:
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
    source = f"(15), {experiment.name}"
    return [
        _row(source, phase, measured, (np.nan, np.nan), "not rounded"),
        _rounded(f"{source}, rounded", rounded, frequency),
    ]


def paper_row() -> Row:
    """Row of the phase method for the phase printed in the paper."""
    return _rounded("(15), Sarban et al. 2012", paper.PHASE, paper.FREQUENCY)


def _rounded(source: str, phase: float, frequency: float) -> Row:
    limits = time_constant_interval(phase, paper.PHASE_RESOLUTION, frequency)
    middle = float(time_constant_from_phase(np.asarray(phase), frequency))
    beyond = "none: the phase is beyond a quarter turn"
    bounds = beyond if np.isnan(limits[1]) else "what rounding to 0.01 rad allows"
    return _row(source, phase, middle, limits, bounds)


def _row(source: str, phase: float, middle: float, limits: tuple[float, float], bounds: str) -> Row:
    return {
        "source": source,
        "phase_rad": phase,
        "series_time_constant_ms": 1e3 * middle,
        "from_ms": 1e3 * limits[0],
        "to_ms": 1e3 * limits[1],
        "bounds": bounds,
    }
