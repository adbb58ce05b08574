"""Which further experiment would tell a study's candidates apart: further_experiments.csv."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from deabayes.comparison.decision import SHOWN
from deabayes.fitted import Fitted
from deabayes.further.information import candidate_information, parameter_information
from deabayes.further.planned import Planned
from deabayes.prediction.outcomes import Predictive

IN_THE_RUNNING = 3.0
"""Nats of log evidence below the best, odds of 20 to 1, within which a candidate counts."""
FIRST = f"{SHOWN}|^nothing to compare"
SHARE_FOR_DENSITY = 2.0 / 3.0
COLUMNS = (
    "experiment", "what", "held_out", "candidates",
    "information_candidate_nats", "information_candidate_error_nats",
    "probability_right", "probability_right_error",
    "failed_share", "failure", "extrapolation",
)  # fmt: skip
Seed = Callable[[str], np.random.SeedSequence]
"""Of an experiment by name."""


@dataclass(frozen=True)
class Outlook:
    """What one candidate says of an experiment, and why some of its draws have no response."""

    predictive: Predictive
    failure: str


def contenders(comparison: pd.DataFrame) -> list[str]:
    """The candidates that the records leave in the running, the chosen one first.

    Those chosen or unresolved, and those whose evidence is close to theirs: a larger model that
    the records neither need nor contradict is passed over, and may be right all the same. No
    candidate that did not converge.
    """
    ranked = comparison[comparison["converged"].astype(bool)]
    passed_over = ranked["verdict"].astype(str).str.startswith("not chosen")
    if passed_over.all():
        return []
    least = ranked["log_evidence"][~passed_over].max() - IN_THE_RUNNING
    kept = ranked[~passed_over | (ranked["log_evidence"] > least)]
    chosen = kept["verdict"].astype(str).str.contains(FIRST)
    ordered = kept.assign(later=~chosen).sort_values(["later", "n_parameters"], kind="stable")
    return [str(name) for name in ordered["candidate"]]


def further_table(
    planned: Sequence[Planned], candidates: Mapping[str, Fitted], seed: Seed
) -> pd.DataFrame:
    """One row per experiment, the most telling first.

    Parameters
    ----------
    candidates : those in the running, with a few hundred draws each in random order.
    """
    names = [f"information_{c}{end}" for c in candidates for end in ("_nats", "_error_nats")]
    rows = [_row(each, candidates, np.random.default_rng(seed(each.name))) for each in planned]
    table = pd.DataFrame(rows, columns=[*COLUMNS, *names])
    key = "information_candidate_nats" if len(candidates) > 1 else (names or [COLUMNS[0]])[0]
    return table.sort_values(key, ascending=False, kind="stable", ignore_index=True)


def outlook(planned: Planned, fitted: Fitted) -> Outlook:
    """A candidate's predictive of an experiment: a draw that fails on a record fails on all."""
    found = [fitted.reading(record) for record in planned.records]
    kept = np.logical_and.reduce([ok for _, ok in found])
    failed = int(np.sum(~kept))
    failure = ""
    if failed:
        record = planned.records[0]
        lost = {n: np.ascontiguousarray(v[~kept]) for n, v in fitted.draws.items()}
        system = fitted.system_for(record)
        failure = system.failure_note(record.excitation, record.coordinate, lost)
    if kept.sum() < 2:  # a density and a sample ask for one draw each
        return Outlook(Predictive((), (), (kept.size, kept.size)), failure)
    picked = np.flatnonzero(kept)
    cut = max(int(SHARE_FOR_DENSITY * picked.size), 1)
    known, others = (
        tuple(reading.of_draws(part) for reading, _ in found)
        for part in (picked[:cut], picked[cut:])
    )
    return Outlook(Predictive(known, others, (failed, kept.size)), failure)


def _row(
    planned: Planned, candidates: Mapping[str, Fitted], rng: np.random.Generator
) -> dict[str, object]:
    outlooks = {name: outlook(planned, fitted) for name, fitted in candidates.items()}
    row: dict[str, object] = {
        "experiment": planned.name,
        "what": planned.what,
        "held_out": planned.held_out,
        "candidates": ", ".join(candidates),
        "failed_share": np.mean([each.predictive.failed_share for each in outlooks.values()]),
        "failure": "; ".join(
            f"{n}: {each.failure}" for n, each in outlooks.items() if each.failure
        ),
        "extrapolation": next(iter(candidates.values())).extrapolation(planned.records[0]),
    }
    if len(candidates) > 1:
        found = candidate_information([each.predictive for each in outlooks.values()], rng)
        row |= {
            "information_candidate_nats": max(found.nats, 0.0),
            "information_candidate_error_nats": found.nats_error,
            "probability_right": found.probability_right,
            "probability_right_error": found.probability_right_error,
        }
    for name, each in outlooks.items():
        if each.predictive.known:
            nats, error = parameter_information(each.predictive)
            row |= {f"information_{name}_nats": nats, f"information_{name}_error_nats": error}
    return row
