"""A membrane study after its fits, without fits: draws and records are made up."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from tests.shared.membranes import PLAIN, golden_draws, membrane, sine, step

from deabayes import papers
from deabayes.experiment import Experiment
from deabayes.noise import REGISTRY as NOISE
from deabayes.papers.base import StudyContext
from deabayes.posteriors.fitted import Fitted
from deabayes.study import Study

PAPER = {
    "mu_alpha_Pa": 35e3,
    "zeta_alpha_Pa_s": 1e5,
    "mu_beta_Pa": [15e3, 15e3, 15e3],
    "zeta_beta_Pa_s": [6e4, 5.025e5, 1.2525e6],
    "J_alpha": 110.0,
    "J_beta": 55.0,
}
"""Parameters of the paper's step, Gent limits stand-ins."""
CANDIDATES = ("kv_gm_1", "kv_gm_2")


def draws(units: int, count: int = 20, spread: float = 0.02):
    """Draws about the paper's step parameters."""
    rng = np.random.default_rng(units)
    at = golden_draws(PAPER, units)
    return {n: v * np.exp(spread * rng.standard_normal(count)) for n, v in at.items()}


def fitted(candidate: str, **changes) -> Fitted:
    system = membrane(candidate)
    values = draws(system.order, **changes)
    return Fitted(
        candidate,
        PLAIN,
        system,
        NOISE["white"](),
        "absolute",
        "record",
        values,
        (),
        candidate[-1] > "1",
    )


def experiment(name, protocol, excitation, time, response_name, role="validate", **metadata):
    """A record that reads what kv_gm_3 with the paper's parameters gives."""
    system = membrane("kv_gm_3")
    truth = golden_draws(PAPER, 3)
    response = system.predict(excitation, time, response_name, truth)[0]
    return Experiment(
        name, protocol, role, "time", "s", time, response_name, system.responses[response_name],
        response, np.ones(time.size), excitation, metadata=metadata,
    )  # fmt: skip


def context(**changes) -> StudyContext:
    """Steps to 2, 3 and 4 kV, a sine at 0.05 Hz, areas; candidates of one and two units."""
    time = np.r_[np.geomspace(0.25, 20.0, 25), np.linspace(25.0, 600.0, 40)]
    records = [
        experiment(f"{'step' if what == 'displacement' else 'area'}_{kv}kV", "step",
                   step(1e3 * kv), time, what,
                   "calibrate" if (kv, what) == (4, "displacement") else "validate")
        for kv in (4, 3, 2) for what in ("displacement", "area")
    ]  # fmt: skip
    driven = sine(0.05)
    records.append(
        experiment("sine_0p05Hz", "sine", driven, np.arange(0.5, 100.0, 0.5), "displacement")
    )
    study = Study("made_up", Path("data/membrane"), CANDIDATES)
    found = StudyContext(study, PLAIN, records, {name: fitted(name) for name in CANDIDATES})
    return replace(found, **changes)


@cache
def computed(name):
    """One analysis of the made-up membrane study."""
    return papers.module(name).compute(context())
