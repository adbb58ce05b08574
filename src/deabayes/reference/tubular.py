"""Simulate the reference tubular actuator: ``python -m deabayes.reference.tubular data/tubular``.

The stand-in material of the actuator of Sarban et al. (2012) on the paper's creep
protocol, with what its candidates leave out: a third, slow Kelvin unit, the charging
of the capacitance by an amplifier of limited current (4)-(6), (16), a sensor with
delay, offset, drift, correlated noise and quantisation. Inertia is left out.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from deabayes.electrostatics import maxwell_pressure
from deabayes.experiment import FloatArray
from deabayes.reference.sensor import Sensor
from deabayes.reference.tubular_specimen import SPECIMEN
from deabayes.reference.writing import write_record, write_table, write_yaml

SEED = 20120
SAMPLING_INTERVAL = 1e-4
STEP_AT = 0.02
STEP_SAMPLES = 5000
MONITOR_NOISE = 0.3
"""sd of the amplifier's voltage monitor [V]."""
VOLTAGES = {2000: "calibrate", 2500: "validate", 1500: "validate"}
COMMENT = "Written by `python -m deabayes.reference.tubular`; edit that module, not this file."


@dataclass(frozen=True)
class Truth:
    """The simulated actuator and its amplifier, SI."""

    E: tuple[float, ...] = (1.5e6, 12e6, 6e6, 25e6)
    tau: tuple[float, ...] = (6e-3, 0.12, 1.5)
    thickness: float = 80e-6
    relative_permittivity: float = 3.1
    active_length: float = 0.07
    capacitance: float = 180e-9
    series_resistance: float = 954.0
    leakage_resistance: float = 1e9
    current_limit: float = 0.12


TRUTH = Truth()
SENSOR = Sensor(
    delay=4e-4,
    sigma_white=1e-6,
    sigma_ou=1e-6,
    tau_ou=0.01,
    offset=2e-5,
    drift=2e-6,
    resolution=2e-7,
)


def step_response(
    truth: Truth, voltage: float, duration: float
) -> tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]:
    """Amplifier output [V] and displacement [m] as functions of the time since a step command.

    The states are v_C and the strains of the Kelvin units. The amplifier holds its
    current limit until v_C + R_S I_max reaches the commanded voltage, and that
    voltage from then on; DOP853 solves the two stretches.
    """
    stretches = _solve(truth, voltage, duration)

    def states(time: FloatArray) -> FloatArray:
        limited, free = (stretch(np.clip(time, *ends)) for stretch, ends in stretches)
        return np.where(time < stretches[1][1][0], limited, free)

    def amplifier(time: FloatArray) -> FloatArray:
        raised = states(time)[0] + truth.series_resistance * truth.current_limit
        return np.where(time < 0.0, 0.0, np.minimum(raised, voltage))

    def displacement(time: FloatArray) -> FloatArray:
        v_c, *units = states(time)
        strain = _pressure(truth, v_c) / truth.E[0] + np.sum(units, axis=0)
        return np.where(time < 0.0, 0.0, truth.active_length * strain)

    return amplifier, displacement


def _solve(
    truth: Truth, voltage: float, duration: float
) -> list[tuple[Callable[[FloatArray], FloatArray], tuple[float, float]]]:
    """Dense solution and time span of the current-limited stretch and of the rest."""
    from scipy.integrate import solve_ivp

    def slope(time: float, state: FloatArray) -> list[float]:
        current = (voltage - state[0]) / truth.series_resistance
        current = min(current, truth.current_limit) - state[0] / truth.leakage_resistance
        pressure = _pressure(truth, state[0])
        units = zip(state[1:], truth.E[1:], truth.tau, strict=True)
        return [current / truth.capacitance, *((pressure / e - x) / t for x, e, t in units)]

    def released(time: float, state: FloatArray) -> float:
        return float(state[0] + truth.series_resistance * truth.current_limit - voltage)

    released.terminal = True  # type: ignore[attr-defined]
    start = np.zeros(1 + len(truth.tau))
    scale = np.array([1e-6 * voltage, *(1e-9,) * len(truth.tau)])
    options = {
        "method": "DOP853",
        "rtol": 1e-9,
        "atol": 1e-3 * scale,
        "dense_output": True,
        # Longer steps are stable but interpolate badly between.
        "max_step": 0.5 * truth.series_resistance * truth.capacitance,
    }
    limited = solve_ivp(slope, (0.0, duration), start, events=released, **options)
    end = float(limited.t[-1])
    free = solve_ivp(slope, (end, duration), limited.y[:, -1], **options)
    return [(limited.sol, (0.0, end)), (free.sol, (end, duration))]


def _pressure(truth: Truth, voltage: FloatArray) -> FloatArray:
    return maxwell_pressure(voltage, truth.thickness, truth.relative_permittivity)


def record(voltage: float, seed: int) -> dict[str, tuple[FloatArray, int]]:
    """One record: 20 ms of rest and 0.5 s after the step, at 10 kHz."""
    rng = np.random.default_rng([SEED, seed])
    samples = round(STEP_AT / SAMPLING_INTERVAL) + STEP_SAMPLES + 1
    time = np.asarray(SAMPLING_INTERVAL * np.arange(samples), dtype=np.float64)
    amplifier, displacement = step_response(TRUTH, voltage, time[-1] - STEP_AT)
    monitored = amplifier(time - STEP_AT) + MONITOR_NOISE * rng.standard_normal(samples)
    reading = SENSOR.read(displacement, time - STEP_AT, rng)
    return {
        "time [s]": (time, 4),
        "voltage [kV]": (monitored / 1e3, 4),
        "displacement [mm]": (1e3 * reading, 4),
    }


def write(folder: Path) -> None:
    """Write records, experiments.csv, specimen.yaml and truth.yaml."""
    rows = []
    for seed, (voltage, role) in enumerate(VOLTAGES.items()):
        name = f"creep_{voltage}V"
        write_record(folder / "records" / f"{name}.csv", record(float(voltage), seed))
        rows.append(_row(name, role, voltage))
    write_table(folder / "experiments.csv", rows)
    write_yaml(folder / "specimen.yaml", SPECIMEN, COMMENT)
    write_yaml(folder / "truth.yaml", truth_for_scoring(), COMMENT)


def _row(name: str, role: str, voltage: int) -> dict[str, object]:
    return {
        "name": name,
        "protocol": "creep",
        "record": f"records/{name}.csv",
        "role": role,
        "excitation": "voltage",
        "response": "displacement",
        "load_g": 0,
        "note": "step command at 20 ms",
        "voltage_kV": voltage / 1e3,
    }


def truth_for_scoring() -> dict[str, object]:
    """What a fit of these records should find, and what disturbs it; SI."""
    moduli = {f"E_{n}": value for n, value in enumerate(TRUTH.E)}
    times = {f"tau_{n}": value for n, value in enumerate(TRUTH.tau, start=1)}
    others = {key: value for key, value in asdict(TRUTH).items() if key not in ("E", "tau")}
    return {
        "seed": SEED,
        "parameters": {**moduli, **times},
        "specimen": others,
        "sensor": asdict(SENSOR),
        "voltage_monitor": {"sigma_white": MONITOR_NOISE},
    }


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m deabayes.reference.tubular FOLDER")
    write(Path(sys.argv[1]))
