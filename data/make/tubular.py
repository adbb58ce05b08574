"""Simulate the reference tubular actuator: ``python -m data.make.tubular data/tubular``.

One actuator with the stand-in material of Sarban et al. (2012), on the paper's protocols:
creep, the 10 Hz sine, leakage and frequency responses under three loads. It holds what the
candidates leave out: a third, slow Kelvin unit, dielectric absorption, an amplifier of
limited current (16), sensors with delay, offset, drift, correlated noise and quantisation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
from data.make import tubular_frequency as analyser
from data.make.tubular_motion import leakage_current, motion
from data.make.tubular_specimen import SPECIMEN
from data.make.tubular_truth import CURRENT, DISPLACEMENT, LEAKAGE, MONITOR_NOISE, TRUTH
from data.make.writing import numbered, run, write_descriptions, write_record

from deabayes.experiment import FloatArray

SEED = 20120
VOLTAGES = {2000: "calibrate", 2500: "validate", 1500: "validate"}
LOADS = (100, 300, 500)
"""Of the frequency responses [g]."""
Columns = dict[str, tuple[FloatArray, int]]


def creep(voltage: float, seed: int) -> Columns:
    """20 ms of rest and 0.5 s after a step command, at 10 kHz, without load."""
    rng = np.random.default_rng([SEED, seed])
    time = _times(0.52, 1e-4)
    since = time - 0.02
    moved = motion(TRUTH, lambda t: voltage, float(since[-1]))
    monitored = _monitored(moved.amplifier(since), rng)
    reading = DISPLACEMENT.read(moved.displacement, since, rng)
    return {
        "time [s]": (time, 4),
        "voltage [kV]": monitored,
        "displacement [mm]": (1e3 * reading, 4),
    }


def sine(seed: int) -> Columns:
    """5 ms of rest, then v_CON = 1.25 sin(20 pi t) + 1.25 (x 1000) for 2 s, at 2 kHz."""
    rng = np.random.default_rng([SEED, seed])
    time = _times(2.005, 5e-4)
    since = time - 0.005
    moved = motion(
        TRUTH, lambda t: 1250.0 * math.sin(20.0 * math.pi * t) + 1250.0, float(since[-1])
    )
    monitored = _monitored(moved.amplifier(since), rng)
    current = CURRENT.read(moved.current, since, rng)
    reading = DISPLACEMENT.read(moved.displacement, since, rng)
    return {
        "time [s]": (time, 4),
        "voltage [kV]": monitored,
        "current [mA]": (1e3 * current, 3),
        "displacement [mm]": (1e3 * reading, 4),
    }


def leakage(seed: int) -> Columns:
    """2.1 s of rest, then 2 kV held for 200 s, at 5 Hz: the first sample misses the charging."""
    rng = np.random.default_rng([SEED, seed])
    time = _times(202.0, 0.2)
    since = time - 2.1
    monitored = _monitored(np.where(since < 0.0, 0.0, 2000.0), rng)
    current = LEAKAGE.read(lambda t: leakage_current(TRUTH, 2000.0, t), since, rng)
    return {
        "time [s]": (time, 1),
        "voltage [kV]": monitored,
        "current [uA]": (1e6 * current, 3),
    }


def frequency_response(load: int, seed: int) -> Columns:
    """Gain and phase of the strain for A = 500 V about B = 2000 V, 1-100 Hz."""
    rng = np.random.default_rng([SEED, seed])
    frequency = np.asarray(np.arange(1.0, 100.25, 0.5), dtype=np.float64)
    gain, phase = analyser.measured(TRUTH, DISPLACEMENT, 500.0, 2000.0, frequency, 1e-3 * load, rng)
    return {
        "frequency [Hz]": (frequency, 1),
        "gain [%/V]": (100.0 * gain, 8),
        "phase [deg]": (np.degrees(phase), 3),
    }


def _times(last: float, interval: float) -> FloatArray:
    return np.asarray(interval * np.arange(round(last / interval) + 1), dtype=np.float64)


def _monitored(voltage: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """The amplifier's voltage monitor [kV]."""
    return (voltage + MONITOR_NOISE * rng.standard_normal(voltage.size)) / 1e3, 4


def write(folder: Path) -> None:
    """Write records, experiments.csv, specimen.yaml and truth.yaml."""
    for name, columns in records().items():
        write_record(folder / "records" / f"{name}.csv", columns())
    write_descriptions(folder, rows(), SPECIMEN, truth_for_scoring(), "tubular")


def records() -> dict[str, Callable[[], Columns]]:
    """Every record's name and what computes its columns."""
    found: dict[str, Callable[[], Columns]] = {
        f"creep_{voltage}V": lambda v=voltage, s=seed: creep(float(v), s)  # type: ignore[misc]
        for seed, voltage in enumerate(VOLTAGES)
    }
    found |= {"sine_10Hz": lambda: sine(10), "leakage_2000V": lambda: leakage(11)}
    return found | {
        f"frequency_response_{load}g": lambda m=load, s=seed: frequency_response(m, s)  # type: ignore[misc]
        for seed, load in enumerate(LOADS, start=20)
    }


def rows() -> list[dict[str, object]]:
    """The rows of experiments.csv; the sine's record stands behind two of them."""
    creeps = [
        _row(f"creep_{voltage}V", "creep", role, "step command at 20 ms", voltage_kV=voltage / 1e3)
        for voltage, role in VOLTAGES.items()
    ]
    waved: dict[str, object] = {"frequency_Hz": 10.0, "amplitude_kV": 1.25, "bias_kV": 1.25}
    through: dict[str, object] = {"response": "current"}
    note = "1.25 sin(20 pi t) + 1.25 kV from 5 ms on"
    responses = [
        _row(
            f"frequency_response_{load}g", "frequency_response", "validate",
            "strain per volt of the amplifier's sine; the phase holds the sensor's delay",
            excitation="frequency", response="gain", load_g=load, amplitude_kV=0.5, bias_kV=2.0,
        )
        for load in LOADS
    ]  # fmt: skip
    return [
        *creeps,
        _row("sine_10Hz", "sine", "validate", note) | waved,
        _row("electrical_10Hz", "sine", "calibrate", note, "sine_10Hz") | through | waved,
        _row("leakage_2000V", "step", "calibrate", "step command at 2.1 s", voltage_kV=2.0)
        | through,
        *responses,
    ]  # fmt: skip


def _row(
    name: str, protocol: str, role: str, note: str, record: str | None = None, **others: object
) -> dict[str, object]:
    return {
        "name": name,
        "protocol": protocol,
        "record": f"records/{record or name}.csv",
        "role": role,
        "excitation": "voltage",
        "response": "displacement",
        "load_g": 0,
        "note": note,
        "voltage_kV": "",
        "frequency_Hz": "",
        "amplitude_kV": "",
        "bias_kV": "",
    } | others


def truth_for_scoring() -> dict[str, object]:
    """What a fit of these records should find, and what disturbs it; SI."""
    parameters = {"E_0": TRUTH.E[0]} | numbered(E=TRUTH.E[1:], tau=TRUTH.tau)
    others = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(TRUTH).items()
        if key not in ("E", "tau")
    }
    return {
        "seed": SEED,
        "parameters": parameters,
        "specimen": others,
        "sensor": asdict(DISPLACEMENT),
        "voltage_monitor": {"sigma_white": MONITOR_NOISE},
        "current_monitor": asdict(CURRENT),
        "leakage_meter": asdict(LEAKAGE),
        "frequency_response": {
            "relative_error": analyser.RELATIVE_ERROR,
            "error_length": analyser.ERROR_LENGTH,
            "periods": analyser.PERIODS,
        },
    }


if __name__ == "__main__":
    run(write)
