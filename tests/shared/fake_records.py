"""Records of a made-up study: linear viscoelastic curves with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray

RELAXATION_TIMES = (0.7, 9.0, 120.0, 900.0)
MODULI = (26e3, 26e3, 11e3, 6e3)


@dataclass(frozen=True)
class Fake:
    """What the made-up study is like."""

    name: str = "fake_strip"
    provenance: str = "measured"
    converged: bool = True
    candidates: tuple[int, ...] = (1, 2, 3)
    protocols: tuple[str, ...] = ("relaxation", "relaxation", "load_unload", "load_unload")
    verdict: str = "chosen: the smallest order the data cannot do without"
    warnings: tuple[str, ...] = ()
    extrapolation: str = ""
    correlated_noise: float = 0.4e3
    noise: str = "ornstein_uhlenbeck"
    sensitivities: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """To prior and likelihood, by quantity, in place of made-up ones."""


def experiment_of(fake: Fake, index: int, protocol: str, rng: np.random.Generator) -> Experiment:
    time = {
        "relaxation": np.geomspace(0.1, 1800, 120),
        "creep": np.geomspace(1e-3, 0.5, 120),
        "sine": np.linspace(0, 200, 1500),
    }.get(protocol, np.linspace(0.1, 120, 160))
    amplitude = 1.5 + 0.5 * (index % 6)
    excitation = _drive(protocol, time, amplitude)
    tau, mu = np.array(RELAXATION_TIMES), np.array(MODULI)
    clean = curve(time, excitation, 35e3, mu[None], tau[None])[0]
    if protocol == "load_unload":
        clean = clean + 3e3 * np.tanh(2 * np.gradient(excitation, time) * 1e2) * (excitation - 1)
    response = clean + _correlated(time, fake.correlated_noise, 30.0, rng)
    response += 150.0 * rng.standard_normal(time.size)
    sine = protocol in ("sine", "creep")
    return Experiment(
        name=f"{protocol}_stretch_{amplitude:g}".replace(".", "p") + f"_{index}",
        protocol=protocol,
        role="validate" if index % 3 == 2 else "calibrate",
        coordinate_name="time",
        coordinate_unit="s",
        coordinate=time,
        response_name="strain" if sine else "nominal_stress",
        response_unit="1" if sine else "Pa",
        response=response / (4e6 if sine else 1.0),
        samples_averaged=np.ones_like(time),
        excitation=Excitation(
            "voltage" if sine else "stretch",
            "V" if sine else "1",
            time,
            excitation * (1e3 if sine else 1.0),
        ),
        metadata={"stretch": amplitude, "operator": "AB"},
        provenance=fake.provenance,
        record_sha256="0" * 64,
        steps=({"step": "mask_before", "settings": {"time": "0.1 s"}, "masked": [[0.0, 0.1]]},),
        warnings=fake.warnings if index == 0 else (),
    )


def _drive(protocol: str, time: FloatArray, amplitude: float) -> FloatArray:
    if protocol == "load_unload":
        return 1 + (amplitude - 1) * (1 - np.abs(2 * time / time[-1] - 1))
    if protocol == "sine":
        return 1 + (amplitude - 1) * (1 - np.cos(2 * np.pi * 0.05 * time)) / 2
    return np.full_like(time, amplitude)


def curve(
    time: FloatArray,
    stretch: FloatArray,
    mu: float | FloatArray,
    branch: FloatArray,
    tau: FloatArray,
) -> FloatArray:
    """Made-up stress (W, N): elastic part plus relaxing branches."""
    elastic = np.atleast_1d(mu)[:, None] * (stretch - stretch**-2.0)[None]
    decay = np.exp(-time[None, None] / tau[:, :, None])
    return elastic + 0.6 * np.sum(branch[:, :, None] * decay, axis=1) * (stretch - 1)[None]


def _correlated(time: FloatArray, sd: float, length: float, rng: np.random.Generator) -> FloatArray:
    values = np.empty_like(time)
    values[0] = sd * rng.standard_normal()
    for k, step in enumerate(np.diff(time), start=1):
        kept = np.exp(-step / length)
        values[k] = kept * values[k - 1] + sd * np.sqrt(1 - kept**2) * rng.standard_normal()
    return values
