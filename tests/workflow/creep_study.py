"""Creep of the reference actuator as the candidates without mass assume it: nothing rings."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from data.make.tubular_truth import DISPLACEMENT, MONITOR_NOISE, TRUTH
from data.make.writing import write_record, write_table

import deabayes

VOLTAGES = (2000, 2500, 1500)


def write_creep_study(shipped: Path, folder: Path) -> Path:
    """The shipped specimen with records of its chain and circuit alone, 0.5 s at 10 kHz."""
    folder.mkdir(parents=True)
    shutil.copy(shipped / "specimen.yaml", folder)
    time = np.arange(5201) * 1e-4
    for seed, voltage in enumerate(VOLTAGES):
        rng = np.random.default_rng(seed)
        amplifier = voltage * np.clip((time - 0.02) / 2e-3, 0.0, 1.0)  # as its current lets it
        displacement = _displacement(time, amplifier)
        reading = DISPLACEMENT.read(lambda t, d=displacement: np.interp(t, time, d), time, rng)
        monitored = amplifier + MONITOR_NOISE * rng.standard_normal(time.size)
        columns = {"time [s]": (time, 4), "voltage [kV]": (monitored / 1e3, 4),
                   "displacement [mm]": (1e3 * reading, 4)}  # fmt: skip
        write_record(folder / "records" / f"creep_{voltage}V.csv", columns)
    write_table(folder / "experiments.csv", [_row(voltage) for voltage in VOLTAGES])
    return folder


def _displacement(time: np.ndarray, amplifier: np.ndarray) -> np.ndarray:
    moduli = {f"E_{n}": value for n, value in enumerate(TRUTH.E)}
    times = {f"tau_{n}": value for n, value in enumerate(TRUTH.tau, start=1)}
    names = ("series_resistance", "leakage_resistance", "capacitance", "thickness")
    quantities = {name: getattr(TRUTH, name) for name in (*names, "relative_permittivity")}
    found = deabayes.simulate(
        "tubular", "voigt_kelvin_3_circuit", moduli | times, quantities, time, voltage=amplifier
    )
    return TRUTH.active_length * found.strain.values


def _row(voltage: int) -> dict[str, object]:
    name = f"creep_{voltage}V"
    return {
        "name": name,
        "protocol": "creep",
        "record": f"records/{name}.csv",
        "role": "calibrate" if voltage == 2000 else "validate",
        "excitation": "voltage",
        "response": "displacement",
    }
