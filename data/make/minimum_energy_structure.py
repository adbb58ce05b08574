"""Simulate the reference minimum-energy structure.

``python -m data.make.minimum_energy_structure data/minimum_energy_structure``
writes the structure of the paper of 2019 on its protocols: forces against slider positions at
0 to 5 kV, biased sines of 4 and 5 kV at 1 to 10 Hz, and a sweep through the resonance. It
holds what its candidates leave out: see `minimum_energy_structure_truth`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from data.make import minimum_energy_structure_pull as pull
from data.make.minimum_energy_structure_motion import motion
from data.make.minimum_energy_structure_specimen import SPECIMEN
from data.make.minimum_energy_structure_truth import (
    LASER,
    LOAD_CELL,
    MONITOR_NOISE,
    STROKE,
    TILT,
    TRUTH,
    tilted,
)
from data.make.writing import numbered, run, write_descriptions, write_record

from deabayes.experiment import FloatArray

SEED = 20190
REST = 0.2
"""Seconds at rest, without voltage, before each voltage in time."""
INTERVAL = 1e-3
PERIODS = 50
Columns = dict[str, tuple[FloatArray, int]]


@dataclass(frozen=True)
class Pull:
    """A quasi-static record at one voltage [V]."""

    voltage: float
    role: str

    @property
    def name(self) -> str:
        """`quasi_static_5kV`."""
        return f"quasi_static_{self.voltage / 1e3:g}kV"

    def columns(self, seed: int) -> Columns:
        """Voltage, stage position and the load cell's force."""
        rng = np.random.default_rng([SEED, seed])
        position = pull.positions()
        read = pull.measured(TRUTH, self.voltage, rng)
        return {
            "voltage [kV]": (np.full(position.shape, self.voltage / 1e3), 4),
            "displacement [mm]": (1e3 * position, 2),
            "force [mN]": (1e3 * read, 2),
        }

    def row(self) -> dict[str, object]:
        """Its row of experiments.csv."""
        note = f"mean of the ways out and back at {1e3 * pull.SPEED:g} mm/s"
        return _row(self.name, "quasi_static", self.role, note, self.voltage) | {
            "excitation": "displacement",
            "response": "force",
        }


@dataclass(frozen=True)
class Wave:
    """A record in time: the paper's (1), its highest voltage [V] and frequency [Hz].

    With a second frequency it sweeps from the first to that, logarithmically.
    """

    highest: float
    frequency: float
    role: str
    last_frequency: float | None = None
    duration: float = 0.0

    @property
    def name(self) -> str:
        """`sine_5kV_1Hz`, `sweep_5kV`."""
        kind = f"{self.highest / 1e3:g}kV"
        return f"sine_{kind}_{self.frequency:g}Hz" if self._steady else f"sweep_{kind}"

    @property
    def _steady(self) -> bool:
        return self.last_frequency is None

    @property
    def seconds(self) -> float:
        """Its length after the rest."""
        return PERIODS / self.frequency if self._steady else self.duration

    def command(self, time: float) -> float:
        """Voltage [V] asked for at a time [s] since the end of the rest."""
        cycles = self.frequency * time
        if self.last_frequency is not None:
            growth = math.log(self.last_frequency / self.frequency) / self.duration
            cycles = self.frequency * math.expm1(growth * time) / growth
        wave = math.sin(2.0 * math.pi * cycles - 0.5 * math.pi)
        return 0.5 * ((self.highest - 500.0) * wave + self.highest + 500.0)

    def columns(self, seed: int) -> Columns:
        """Time, the amplifier's monitor and the laser's displacement."""
        rng = np.random.default_rng([SEED, seed])
        samples = round((REST + self.seconds) / INTERVAL) + 1
        time = np.asarray(INTERVAL * np.arange(samples), dtype=np.float64)
        since = time - REST
        moved = motion(TRUTH, self.command, float(since[-1]))
        monitored = moved.amplifier(since) + MONITOR_NOISE * rng.standard_normal(samples)
        reading = LASER.read(lambda t: tilted(moved.displacement(t)), since, rng)
        return {
            "time [s]": (time, 3),
            "voltage [kV]": (monitored / 1e3, 4),
            "displacement [mm]": (1e3 * reading, 3),
        }

    def row(self) -> dict[str, object]:
        """Its row of experiments.csv."""
        if self._steady:
            note = f"sine from 0.5 kV starts at {REST:g} s"
            frequency: float | str = self.frequency
        else:
            note = f"sweep of {self.frequency:g} to {self.last_frequency:g} Hz from {REST:g} s on"
            frequency = ""
        protocol = "sine" if self._steady else "sweep"
        row = _row(self.name, protocol, self.role, note, self.highest)
        return row | {"frequency_Hz": frequency}


def _row(name: str, protocol: str, role: str, note: str, voltage: float) -> dict[str, object]:
    return {
        "name": name,
        "protocol": protocol,
        "record": f"records/{name}.csv",
        "role": role,
        "excitation": "voltage",
        "response": "displacement",
        "note": note,
        "voltage_kV": voltage / 1e3,
        "frequency_Hz": "",
    }


def _sines() -> tuple[Wave, ...]:
    """The paper fits 1, 5 and 10 Hz at 5 kV and predicts the others (Table 5)."""
    return tuple(
        Wave(highest, float(frequency), role)
        for highest in (5e3, 4e3)
        for frequency in range(1, 11)
        for role in ["calibrate" if highest == 5e3 and frequency in (1, 5, 10) else "validate"]
    )


RECORDS: tuple[Pull | Wave, ...] = (
    *(Pull(1e3 * kV, "calibrate" if kV in (0, 5) else "validate") for kV in (0, 2, 3, 4, 5)),
    *_sines(),
    Wave(5e3, 1.0, "validate", last_frequency=60.0, duration=40.0),
)


def write(folder: Path) -> None:
    """Write records, experiments.csv, specimen.yaml and truth.yaml; takes a minute."""
    for seed, settings in enumerate(RECORDS):
        write_record(folder / "records" / f"{settings.name}.csv", settings.columns(seed))
    describe(folder)


def describe(folder: Path) -> None:
    """Write what describes the records: they take a minute, this does not."""
    rows = [settings.row() for settings in RECORDS]
    write_descriptions(folder, rows, SPECIMEN, truth_for_scoring(), "minimum_energy_structure")


def truth_for_scoring() -> dict[str, object]:
    """What a fit of these records should find, and what disturbs it; SI."""
    parameters = numbered(mu=TRUTH.mu, alpha=TRUTH.alpha, k=TRUTH.k, tau=TRUTH.tau)
    parameters |= {name: getattr(TRUTH, name) for name in ("relative_permittivity", "eta_0")}
    others = asdict(TRUTH) | {"hinge_stiffness": TRUTH.hinge_stiffness}
    given = ("mu", "alpha", "k", "xi", *parameters)
    return {
        "seed": SEED,
        "parameters": parameters,
        "specimen": {name: value for name, value in others.items() if name not in given},
        "laser": asdict(LASER) | {"tilt": TILT, "tilt_stroke": STROKE},
        "load_cell": asdict(LOAD_CELL),
        "voltage_monitor": {"sigma_white": MONITOR_NOISE},
    }


if __name__ == "__main__":
    run(write)
