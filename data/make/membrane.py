"""Simulate the reference membrane: ``python -m data.make.membrane data/membrane``.

The membrane of Nguyen et al. (2021) on the paper's protocols: steps to 2, 3 and 4 kV for
600 s, and sines of 2 kV at 0.01, 0.02 and 0.05 Hz, with what its candidates leave out: a
slow fourth Maxwell unit, the charging of the membrane by an amplifier of limited current,
a sensor with delay, offset, drift, correlated noise and quantisation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from data.make.membrane_specimen import SPECIMEN
from data.make.sensor import Sensor
from data.make.writing import numbered, run, write_descriptions, write_record

from deabayes.experiment import FloatArray

SEED = 20210
REST = 5.0
"""Seconds at rest, without voltage, before each command."""
MONITOR_NOISE = 0.3
"""sd of the amplifier's voltage monitor [V]."""
Command = Callable[[float], float]


@dataclass(frozen=True)
class Truth:
    """The simulated membrane and its amplifier, SI."""

    mu_alpha: float = 35e3
    zeta_alpha: float = 1e5
    J_alpha: float = 110.0
    mu_beta: tuple[float, ...] = (15e3, 15e3, 15e3, 5e3)
    tau_beta: tuple[float, ...] = (4.0, 33.5, 83.5, 600.0)
    J_beta: float = 55.0
    permittivity: float = 4.11e-11
    thickness: float = 1e-3
    side_length: float = 0.01
    prestretch: float = 3.0
    current_limit: float = 5e-6


@dataclass(frozen=True)
class Record:
    """One record's protocol: the commanded voltage after REST, its length and sampling."""

    protocol: str
    role: str
    amplitude: float
    frequency: float
    duration: float
    interval: float

    @property
    def name(self) -> str:
        """`step_4kV`, `sine_0p05Hz`."""
        if self.protocol == "step":
            return f"step_{self.amplitude / 1e3:g}kV"
        return f"sine_{self.frequency:g}Hz".replace(".", "p")

    def command(self, time: float) -> float:
        """Commanded voltage [V] at a time [s] since the end of the rest."""
        if self.protocol == "step":
            return self.amplitude
        return self.amplitude * float(np.sin(2.0 * np.pi * self.frequency * time))


TRUTH = Truth()
RECORDS = (
    Record("step", "calibrate", 4e3, 0.0, 600.0, 0.1),
    Record("step", "validate", 3e3, 0.0, 600.0, 0.1),
    Record("step", "validate", 2e3, 0.0, 600.0, 0.1),
    Record("sine", "validate", 2e3, 0.01, 500.0, 0.1),
    Record("sine", "validate", 2e3, 0.02, 250.0, 0.05),
    Record("sine", "validate", 2e3, 0.05, 200.0, 0.05),
)
SENSOR = Sensor(
    delay=2e-3,
    sigma_white=2e-6,
    sigma_ou=3e-6,
    tau_ou=2.0,
    offset=2e-5,
    drift=5e-9,
    resolution=0.01 / 2**16,
)
"""Displacement [m]."""
CAMERA = Sensor(
    delay=0.0,
    sigma_white=1.5e-6,
    sigma_ou=1e-6,
    tau_ou=5.0,
    offset=0.0,
    drift=0.0,
    resolution=1e-7,
)
"""Area [m^2]."""


def response(
    truth: Truth, command: Command, duration: float
) -> tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]:
    """Voltage [V] and stretch as functions of the time since the command.

    The states are the charge, lambda and the xi_i. The amplifier follows the command as
    fast as its current limit lets it: a first-order lag of 1 ms with a bounded current.
    """
    from scipy.integrate import solve_ivp

    elastance = _elastance(truth)
    start = np.array([0.0, *(truth.prestretch,) * (1 + len(truth.tau_beta))])
    full = 4e3 * truth.prestretch**4 / elastance
    solution = solve_ivp(
        _slope(truth, command), (0.0, duration), start, method="Radau", rtol=1e-9,
        atol=[1e-9 * full, *(1e-10,) * (start.size - 1)], dense_output=True, max_step=2.0,
    ).sol  # fmt: skip

    def volts(time: FloatArray) -> FloatArray:
        charge, lam = solution(np.clip(time, 0.0, duration))[:2]
        return np.where(time < 0.0, 0.0, charge * elastance / lam**4)

    def stretch(time: FloatArray) -> FloatArray:
        lam = solution(np.clip(time, 0.0, duration))[1]
        return np.where(time < 0.0, truth.prestretch, lam)

    return volts, stretch


def _elastance(truth: Truth) -> float:
    """One over the capacitance of the film at stretch 1."""
    return truth.thickness / (truth.permittivity * truth.side_length**2)


def _slope(truth: Truth, command: Command) -> Callable[[float, FloatArray], list[float]]:
    """Rates of the states (see `response`)."""
    charge_lag, elastance = 1e-3, _elastance(truth)
    gain = truth.permittivity / truth.thickness**2
    prestress = truth.mu_alpha * _gent(truth.prestretch, 1.0, truth.J_alpha)

    def slope(time: float, state: FloatArray) -> list[float]:
        charge, lam, *dashpots = state
        volts = charge * elastance / lam**4
        current = (command(time) - volts) / (charge_lag * elastance) * lam**4
        current = max(-truth.current_limit, min(current, truth.current_limit))
        total = gain * volts**2 * lam**3 + prestress
        total -= truth.mu_alpha * _gent(lam, 1.0, truth.J_alpha)
        rates = []
        for xi, mu, tau in zip(dashpots, truth.mu_beta, truth.tau_beta, strict=True):
            total -= mu * _gent(lam, xi, truth.J_beta)
            rates.append(_gent(lam, xi, truth.J_beta) * lam / (xi * tau))
        return [current, total / truth.zeta_alpha, *rates]

    return slope


def _gent(lam: float, xi: float, limit: float) -> float:
    """Nominal equal-biaxial stress of a Gent spring over its modulus, elastic stretch lam/xi."""
    argument = 1.0 - (2.0 * lam**2 / xi**2 + xi**4 / lam**4 - 3.0) / limit
    return (lam / xi**2 - xi**4 / lam**5) / argument


def record(settings: Record, seed: int) -> dict[str, tuple[FloatArray, int]]:
    """Columns of one record."""
    rng = np.random.default_rng([SEED, seed])
    samples = round((REST + settings.duration) / settings.interval) + 1
    time = np.asarray(settings.interval * np.arange(samples), dtype=np.float64)
    volts, stretch = response(TRUTH, settings.command, settings.duration)
    since = time - REST
    monitored = volts(since) + MONITOR_NOISE * rng.standard_normal(samples)
    side = TRUTH.side_length
    reading = SENSOR.read(lambda t: side * (stretch(t) - TRUTH.prestretch), since, rng)
    area = CAMERA.read(lambda t: (side * stretch(t)) ** 2, since, rng)
    return {
        "time [s]": (time, 2),
        "voltage [kV]": (monitored / 1e3, 4),
        "displacement [mm]": (1e3 * reading, 5),
        "area [mm^2]": (1e6 * area, 1),
    }


def write(folder: Path) -> None:
    """Write records, experiments.csv, specimen.yaml and truth.yaml."""
    for seed, settings in enumerate(RECORDS):
        write_record(folder / "records" / f"{settings.name}.csv", record(settings, seed))
    areas = [_area_row(settings) for settings in reversed(RECORDS) if settings.protocol == "step"]
    rows = [*(_row(settings) for settings in RECORDS), *areas]
    write_descriptions(folder, rows, SPECIMEN, truth_for_scoring(), "membrane")


def _row(settings: Record) -> dict[str, object]:
    step = settings.protocol == "step"
    return {
        "name": settings.name,
        "protocol": settings.protocol,
        "record": f"records/{settings.name}.csv",
        "role": settings.role,
        "excitation": "voltage",
        "response": "displacement",
        "note": f"{'step command' if step else 'sine starts'} at {REST:g} s",
        "voltage_kV": settings.amplitude / 1e3,
        "frequency_Hz": "" if step else settings.frequency,
    }


def _area_row(settings: Record) -> dict[str, object]:
    """The area that the camera read during a step: held out, whatever the step's own role."""
    name = settings.name.replace("step", "area")
    return _row(settings) | {"name": name, "role": "validate", "response": "area"}


def truth_for_scoring() -> dict[str, object]:
    """What a fit of these records should find, and what disturbs it; SI."""
    parameters = {name: getattr(TRUTH, name) for name in ("mu_alpha", "zeta_alpha", "J_alpha")}
    parameters |= numbered(mu_beta=TRUTH.mu_beta, tau_beta=TRUTH.tau_beta)
    parameters |= {"J_beta": TRUTH.J_beta, "permittivity": TRUTH.permittivity}
    others = ("thickness", "side_length", "prestretch", "current_limit")
    return {
        "seed": SEED,
        "parameters": parameters,
        "specimen": {name: getattr(TRUTH, name) for name in others},
        "sensor": asdict(SENSOR),
        "camera": asdict(CAMERA),
        "voltage_monitor": {"sigma_white": MONITOR_NOISE},
    }


if __name__ == "__main__":
    run(write)
