"""Membranes, their draws and their voltages, for tests."""

from __future__ import annotations

import dataclasses

import numpy as np

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.systems.membrane.system import Membrane

QUANTITIES = {
    "thickness": Quantity(1e-3, "m"),
    "permittivity": Quantity(4.11e-11, "F/m"),
    "prestretch": Quantity(3.0, "1"),
    "side_length": Quantity(0.01, "m"),
    "density": Quantity(960.0, "kg/m^3"),
}
PLAIN = Specimen("plain", "membrane", {}, QUANTITIES)


def specimen(**changes):
    return dataclasses.replace(PLAIN, quantities={**QUANTITIES, **changes})


def membrane(candidate="kv_gm_3", tolerance=1e-6, specimen=PLAIN, **settings):
    return Membrane(candidate, specimen, tolerance, **settings)


def voltage(time, volts, **conditions):
    return Excitation("voltage", "V", np.array(time, float), np.array(volts, float), conditions)


def step(volts, last=600.0):
    return voltage([0.0, last], [volts, volts])


def sine(frequency, periods=5, per_period=400, amplitude=2000.0):
    phase = np.arange(periods * per_period + 1) / per_period
    return voltage(phase / frequency, amplitude * np.sin(2.0 * np.pi * phase))


def golden_draws(inputs, units, **changes):
    modulus = np.array(inputs["mu_beta_Pa"])
    time = np.array(inputs["zeta_beta_Pa_s"]) / modulus
    values = {"mu_alpha": inputs["mu_alpha_Pa"], "zeta_alpha": inputs["zeta_alpha_Pa_s"]}
    values |= {"J_alpha": inputs.get("J_alpha"), "J_beta": inputs.get("J_beta")} | changes
    for i in range(units):
        values |= {f"mu_beta_{i + 1}": modulus[i], f"tau_beta_{i + 1}": time[i]}
    return {k: np.array([np.inf if v is None else v], dtype=float) for k, v in values.items()}


def prior_draws(system, count, seed=1):
    rng = np.random.default_rng(seed)
    draws = {p.name: p.prior.from_normal(rng.standard_normal(count)) for p in system.parameters()}
    names = [f"tau_beta_{i}" for i in range(1, system.order + 1)]
    ordered = np.sort([draws[name] for name in names], axis=0)
    return draws | dict(zip(names, ordered, strict=True))


def rows(draws, which):
    return {name: values[which] for name, values in draws.items()}
