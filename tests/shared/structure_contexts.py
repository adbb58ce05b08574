"""Two studies of a minimum-energy structure after their fits, without fits: all is made up."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from tests.shared.structures import FILM, PLAIN, STIFFNESS, VISCOSITY, pull, structure, voltage

from deabayes import papers
from deabayes.experiment import Experiment
from deabayes.noise import REGISTRY as NOISE
from deabayes.papers.base import StudyContext
from deabayes.posteriors.fitted import Fitted
from deabayes.study import Study

FILMS = {
    1: {"mu_1": 1.257e3, "alpha_1": 3.807},
    4: {name: value for name, value in FILM.items() if name != "relative_permittivity"},
}
"""Films that pull alike at rest, by number of terms, the last the paper's."""
STATIC, MOVING = ("ogden_1", "ogden_4"), ("ogden_1_units_1", "ogden_1_units_4")
GROUPS = (1, 1, 1, 1, 1, 5, 5)
"""Cycles that make one cycle of a prepared sine's points."""
POINTS, START = 20, 0.2


def draws(candidate: str, count: int = 20, spread: float = 0.01):
    """Draws about the film of as many terms and the paper's fastest units."""
    words = candidate.split("_")
    units = int(words[3]) if "units" in words else 0
    values = FILMS[int(words[1])] | {"relative_permittivity": FILM["relative_permittivity"]}
    if units:
        values |= {"eta_0": 0.1}
        values |= {f"k_{i}": STIFFNESS[i - 1] for i in range(1, units + 1)}
        values |= {
            f"tau_{i}": VISCOSITY[i - 1] / STIFFNESS[i - 1] for i in range(1, units + 1)
        }  # fmt: skip
    rng = np.random.default_rng(units)
    return {n: v * np.exp(spread * rng.standard_normal(count)) for n, v in values.items()}


def fitted(candidate: str, protocol: str, **changes) -> Fitted:
    """A candidate with made-up draws; the first of a study did not converge."""
    values = draws(candidate, **changes)
    count = values["mu_1"].size
    values |= {f"{protocol}.sigma_white": np.geomspace(1e-4, 2e-4, count)}
    converged = candidate not in (STATIC[0], MOVING[0])
    return Fitted(candidate, PLAIN, structure(candidate), NOISE["white"](), "absolute", "record",
                  values, (), converged)  # fmt: skip


def truth(candidate, excitation, coordinate, response):
    values = draws(candidate, 1, 0.0)
    return structure(candidate).predict(excitation, coordinate, response, values)[0]


def force(kilovolts: float) -> Experiment:
    """What the paper's film pulls with."""
    place = np.linspace(-2e-3, 12e-3, 29)
    driven = pull(place, 1e3 * kilovolts)
    read = truth("ogden_4", driven, place, "force")
    role = "calibrate" if kilovolts in (0, 5) else "validate"
    return Experiment(
        f"quasi_static_{kilovolts}kV", "quasi_static", role, "displacement", "m", place,
        "force", "N", read, np.ones(place.size), driven, provenance="simulated",
    )  # fmt: skip


def command(kilovolts, turns):
    """The paper's (1) at these turns [V]."""
    return 1e3 * (0.5 * (kilovolts + 0.5) - 0.5 * (kilovolts - 0.5) * np.cos(2.0 * np.pi * turns))


def driven_from_rest(time, volts):
    """A rest of START seconds at 0 V, then the voltage."""
    return voltage(np.r_[0.0, START, START + time], np.r_[0.0, 0.0, volts])


def moving(name, protocol, driven, time, calibrated=False, **changes) -> Experiment:
    """What four units make of a voltage."""
    made = Experiment(
        name, protocol, "calibrate" if calibrated else "validate", "time", "s", time,
        "displacement", "m", truth("ogden_1_units_4", driven, time, "displacement"),
        np.ones(time.size), driven, provenance="simulated",
    )  # fmt: skip
    return replace(made, **changes)


def sine(kilovolts: float, frequency: float) -> Experiment:
    """A sine as the step `cycles` leaves it: bursts of points with gaps between."""
    cycles = np.cumsum(GROUPS) - np.array(GROUPS) + np.array(GROUPS) // 2
    # A twentieth of a period before the voltage comes on, as the step finds it.
    first = START - 0.05 / frequency
    turns = (cycles[:, None] + (np.arange(POINTS) + 0.5) / POINTS).ravel()
    phase = np.linspace(0.0, sum(GROUPS), 100 * sum(GROUPS) + 1)
    step = {"step": "cycles", "period_s": 1.0 / frequency, "first_cycle_s": first,
            "group_sizes": list(GROUPS)}  # fmt: skip
    return moving(
        f"sine_{kilovolts:g}kV_{frequency:g}Hz", "sine",
        driven_from_rest(phase / frequency, command(kilovolts, phase)),
        first + turns / frequency, kilovolts == 5.0, steps=(step,),
    )  # fmt: skip


def sweep(last: float = 60.0, duration: float = 12.0, spacing: float = 8e-3) -> Experiment:
    """From 1 Hz to `last`, logarithmically, at 5 kV."""
    time = np.arange(0.0, duration, 1e-3)
    growth = np.log(last) / duration
    driven = driven_from_rest(time, command(5.0, np.expm1(growth * time) / growth))
    return moving("sweep_5kV", "sweep", driven, np.arange(START, START + duration, spacing))


@cache
def static() -> StudyContext:
    """Forces at 0, 2 and 5 kV; films of one and of four terms."""
    records = [force(kilovolts) for kilovolts in (0, 2, 5)]
    return _context("made_up_static", STATIC, "quasi_static", records)


@cache
def motion() -> StudyContext:
    """Sines of 1, 5 and 10 Hz at 5 and 4 kV and a sweep; one and four units."""
    records = [sine(kilovolts, f) for kilovolts in (5.0, 4.0) for f in (1.0, 5.0, 10.0)]
    return _context("made_up_motion", MOVING, "sine", [*records, sweep()])


def _context(name, candidates, protocol, records) -> StudyContext:
    study = Study(name, Path("data/minimum_energy_structure"), candidates, noise="white")
    return StudyContext(study, PLAIN, records, {n: fitted(n, protocol) for n in candidates})


@cache
def computed(name, study):
    """One analysis of one of the made-up studies."""
    return papers.module(name).compute({"static": static, "motion": motion}[study]())


def known(context, responses):
    """A context whose models answer with these curves: record -> (S, N)."""
    made = replace(context, _responses={})
    for name in made.candidates:
        made._responses.update({(name, record): curves for record, curves in responses.items()})
    return made


def exact(context, shift=0.0):
    """A context whose models are off by `shift` of each record's range."""
    return known(
        context,
        {e.name: np.tile(e.response - shift * e.response_range, (3, 1))
         for e in context.experiments},
    )  # fmt: skip
