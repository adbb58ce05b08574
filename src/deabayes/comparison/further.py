"""Rank further experiments by how much they tell about candidates and parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import entr, logsumexp

from deabayes.comparison.verdicts import CHOSEN
from deabayes.experiment import PHASE, Experiment, FloatArray
from deabayes.faults import Faults, nearest
from deabayes.posteriors.fitted import Fitted
from deabayes.prediction.outcomes import Predictive, Readings
from deabayes.study import Settings

CONSTANT_AT_END = ("creep", "step", "relaxation")
"""Protocols that end with a constant excitation, which can last longer."""
SHOWN_CONDITIONS = ("deformation", "load_g", "voltage", "bias_kV")
"""Conditions that describe an experiment in words, in their column's unit (voltage: V)."""
TIMELESS = ("quasi_static", "frequency_response")
IN_THE_RUNNING = 3.0
"""Nats below the best log evidence within which a candidate may be right (odds of 20 to 1)."""
FIRST = f"{CHOSEN}|^nothing to compare"
"""Pattern in the verdict of the candidate that comes first."""
SHARE_FOR_DENSITY = 2.0 / 3.0
COLUMNS = (
    "experiment", "what", "held_out", "candidates",
    "information_candidate_nats", "information_candidate_error_nats",
    "probability_right", "probability_right_error",
    "failed_share", "failure", "extrapolation",
)  # fmt: skip
Seed = Callable[[str], np.random.SeedSequence]
"""Function from an experiment's name to its random seed."""


@dataclass(frozen=True)
class Planned:
    """An experiment with all its records (a gain comes with its phase).

    `what` describes the experiment in words.
    """

    name: str
    records: tuple[Experiment, ...]
    what: str
    held_out: bool


def plan(experiments: Sequence[Experiment], asked: Mapping[str, Settings]) -> list[Planned]:
    """List a study's held-out records and the entries of its `further_experiments`.

    Raises
    ------
    Faults : entries that name no record, or ask for a change that the record does not allow.
    """
    protocols = {record.row: record.protocol for record in experiments}
    if wrong := faults(asked, protocols):
        raise Faults([f"further_experiments: {fault}" for fault in wrong])
    rows = {row: tuple(r for r in experiments if r.row == row) for row in protocols}
    held_out = [
        Planned(name, records, described(records[0]), True)
        for name, records in rows.items()
        if records[0].role == "validate"
    ]
    return held_out + [
        _planned(name, rows[str(settings["like"])], settings) for name, settings in asked.items()
    ]


def faults(asked: Mapping[str, Settings], protocols: Mapping[str, str]) -> list[str]:
    """List the faults of entries of `further_experiments`, given the records' protocols."""
    faults = []
    for name, settings in asked.items():
        like = str(settings["like"])
        protocol = protocols.get(like, "")
        if name in protocols:
            faults.append(f"{name} is a record already; give the experiment another name")
        if not protocol:
            faults.append(
                f"{name}: like {like!r} is not a record of the study{nearest(like, protocols)}"
            )
        elif "speed" in settings and protocol in TIMELESS:
            faults.append(f"{name}: {like} ({protocol}) has no time; leave out speed")
        elif "duration" in settings and protocol not in CONSTANT_AT_END:
            faults.append(
                f"{name}: {like} ({protocol}) does not end with a constant excitation that could "
                f"last longer, as {', '.join(CONSTANT_AT_END)} do; leave out duration"
                + ("" if protocol in TIMELESS else ", or give speed")
            )
    return faults


def altered(experiment: Experiment, name: str, settings: Settings) -> Experiment:
    """Return a copy of an experiment, altered by the factors of a `further_experiments` entry.

    `excitation` multiplies the excitation's distance from rest (rest is 1 for a stretch, else 0).
    `speed` divides all times, and the number of raw samples averaged per point (at least 1).
    `duration` multiplies the record's length; the last excitation is held. Responses are NaN.
    """
    factors = {key: float(str(value)) for key, value in settings.items() if key != "like"}
    result = replace(experiment, name=name, role="validate", nodes=None, steps=(), warnings=(),
                     metadata={}, record_sha256="")  # fmt: skip
    result = _scaled(result, factors.get("excitation", 1.0))
    result = _accelerated(result, factors.get("speed", 1.0))
    result = _prolonged(result, factors.get("duration", 1.0))
    return replace(result, response=np.full(result.coordinate.size, np.nan))


def described(experiment: Experiment) -> str:
    """Describe an experiment in words: protocol, range of the excitation, duration."""
    driven = experiment.excitation
    unit = "" if driven.unit == "1" else f" {driven.unit}"
    low, high = driven.values.min(), driven.values.max()
    low, high = (0.0 if abs(end) < 1e-3 * (high - low) else end for end in (low, high))
    conditions = "".join(
        f", {n} {driven.conditions[n]}" for n in SHOWN_CONDITIONS if driven.conditions.get(n)
    )
    text = f"{experiment.protocol}, {driven.name} {low:.4g} to {high:.4g}{unit}{conditions}"
    if experiment.coordinate_name != "time":
        return text
    return f"{text}, {np.ptp(experiment.coordinate):.4g} s"


def _planned(name: str, records: Sequence[Experiment], settings: Settings) -> Planned:
    """Return an experiment like that of `records`, altered by its settings."""
    endings = [PHASE if r.name.endswith(PHASE) and len(records) > 1 else "" for r in records]
    new = tuple(
        altered(record, name + ending, settings)
        for record, ending in zip(records, endings, strict=True)
    )
    return Planned(name, new, f"{described(new[0])}; {_changes(settings)}", False)


def _changes(settings: Settings) -> str:
    """Describe an entry of `further_experiments` in words."""
    words = {"excitation": "excitation × {}", "speed": "{} × as fast", "duration": "{} × as long"}
    parts = [words[key].format(value) for key, value in settings.items() if key in words]
    return f"like {settings['like']}" + (f", {', '.join(parts)}" if parts else " once more")


def _scaled(experiment: Experiment, factor: float) -> Experiment:
    driven = experiment.excitation
    rest = 1.0 if driven.unit == "1" else 0.0

    def scaled(values: FloatArray) -> FloatArray:
        return rest + factor * (values - rest)

    if experiment.coordinate_name == driven.name:
        excitation = replace(
            driven, coordinate=scaled(driven.coordinate), values=scaled(driven.values)
        )
        return replace(experiment, coordinate=scaled(experiment.coordinate), excitation=excitation)
    return replace(experiment, excitation=replace(driven, values=scaled(driven.values)))


def _accelerated(experiment: Experiment, speed: float) -> Experiment:
    if speed == 1.0:
        return experiment
    driven = experiment.excitation
    return replace(
        experiment,
        coordinate=experiment.coordinate / speed,
        samples_averaged=np.maximum(experiment.samples_averaged / speed, 1.0),
        excitation=replace(driven, coordinate=driven.coordinate / speed),
    )


def _prolonged(experiment: Experiment, factor: float) -> Experiment:
    """Hold the last excitation longer; the number of points at most doubles."""
    if factor == 1.0:
        return experiment
    time, driven = experiment.coordinate, experiment.excitation
    last, added = time[-1], (factor - 1.0) * float(np.ptp(time))
    spacing = max(float(time[-1] - time[-2]), added / time.size)
    more = last + spacing * np.arange(1, int(added / spacing + 1e-9) + 1)
    before = driven.coordinate < last
    knots = np.concatenate([driven.coordinate[before], [last, last + added]])
    values = np.concatenate([driven.values[before], np.repeat(driven.at(time[-1:]), 2)])
    averaged = np.append(
        experiment.samples_averaged, np.full(more.size, experiment.samples_averaged[-1])
    )
    return replace(
        experiment,
        coordinate=np.concatenate([time, more]),
        samples_averaged=averaged,
        excitation=replace(driven, coordinate=knots, values=values),
    )


@dataclass(frozen=True)
class CandidateInformation:
    """Information of an outcome y about the right candidate M, with Monte Carlo standard errors.

    Attributes
    ----------
    nats : lower bound of the mutual information of M and y, with all candidates equally probable.
        It is at most the logarithm of their number.
    probability_right : probability that y leads to the right candidate.
    """

    nats: float
    nats_error: float
    probability_right: float
    probability_right_error: float


def candidate_information(
    predictives: Sequence[Predictive], rng: np.random.Generator
) -> CandidateInformation:
    r"""Estimate the mutual information of the candidate M and an experiment's outcome y.

    I(M; y) >= log K + E[log q(M | y)],  q(M | y) = q(y | M) / sum_j q(y | M_j),

    for any q (Barber & Agakov 2003, Advances in Neural Information Processing Systems 16; for
    experiments Foster et al. 2019, arXiv:1903.05480). The outcomes y are drawn from the
    candidates' own predictives. q is the density of their `Predictive`, made from other draws.
    Errors of q can only lower the estimate. Likewise, choosing the candidate with the largest
    q(M | y) is right at most as often as choosing by the true p(M | y). A missing response
    counts as an outcome too.
    """
    count = len(predictives)
    terms = [_of_truth(predictives, truth, rng) for truth in range(count)]
    nats, right = (np.array([term[k] for term in terms]) for k in (0, 1))
    errors = np.sqrt(np.sum(np.array([term[2] for term in terms]) ** 2, axis=0)) / count
    return CandidateInformation(
        float(np.log(count) + nats.mean()), float(errors[0]), float(right.mean()), float(errors[1])
    )


def _of_truth(
    predictives: Sequence[Predictive], truth: int, rng: np.random.Generator
) -> tuple[float, float, tuple[float, float]]:
    """Mean log q(M | y) and share of right choices if candidate `truth` is right, with errors."""
    share = predictives[truth].failed_share
    nats, right = _judged(np.array([[p.log_failed[0]] for p in predictives]), truth)
    if share == 1.0:
        return float(nats[0]), float(right[0]), (0.0, 0.0)
    y = predictives[truth].sample(rng)
    log_q = [_log_response(p, y) for p in predictives]
    seen_nats, seen_right = _judged(np.stack(log_q), truth)
    kept = (1.0 - share) / np.sqrt(len(seen_nats))
    return (
        share * float(nats[0]) + (1.0 - share) * float(seen_nats.mean()),
        share * float(right[0]) + (1.0 - share) * float(seen_right.mean()),
        (kept * float(seen_nats.std()), kept * float(seen_right.std())),
    )


def _log_response(predictive: Predictive, y: Readings) -> FloatArray:
    """log q(y | M) of outcomes with a response; -inf if no draw of the candidate has one."""
    if not predictive.known:
        return np.full(len(y[0]), -np.inf)
    return predictive.log_failed[1] + predictive.log_density(y)


def _judged(log_q: FloatArray, truth: int) -> tuple[FloatArray, FloatArray]:
    """log q(M | y) of the true candidate and share of right choices, from log q(y | M) (K, Y).

    If several candidates share the largest density, one of them is chosen at random.
    """
    best = log_q >= log_q.max(axis=0) - 1e-12
    right = np.where(best[truth], 1.0 / best.sum(axis=0), 0.0)
    return np.asarray(log_q[truth] - logsumexp(log_q, axis=0)), right


def parameter_information(predictive: Predictive) -> tuple[float, float]:
    r"""Expected information about a candidate's parameters in nats, and its standard error.

    (1 - f) E[1/2 log det(I + C^(-1/2) F F^T C^(-1/2))] - f log f - (1 - f) log(1 - f)

    Here f is the share of draws without a response, F F^T the covariance of the curves, and E the
    mean over draws of the noise covariance C (Lindley 1956, 10.1214/aoms/1177728069, for a linear
    model with normal noise; Chaloner & Verdinelli 1995, 10.1214/ss/1177009939). The terms in f
    are the information from whether there is a response. The first term is exact for curves
    linear in the parameters, and otherwise the largest value that their covariance allows.
    Information about the noise is left out.
    """
    failed = predictive.failed_share
    values = (1.0 - failed) * np.array([normal.information for normal in predictive.normals])
    failing = float(entr(failed) + entr(1.0 - failed))
    return float(values.mean()) + failing, float(values.std() / np.sqrt(values.size))


@dataclass(frozen=True)
class Outlook:
    """A candidate's prediction of an experiment, and why some of its draws have no response."""

    predictive: Predictive
    failure: str


def contenders(comparison: pd.DataFrame) -> list[str]:
    """List the converged candidates that may still be right, the chosen one first.

    These are the chosen and unresolved candidates, and others whose evidence is close to theirs.
    A larger model that the records neither need nor contradict is not chosen, but may be right.
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
    """Tabulate the experiments, one row each, the most informative first.

    Parameters
    ----------
    candidates : those that may be right (`contenders`), with a few hundred draws each in random
        order.
    """
    names = [f"information_{c}{end}" for c in candidates for end in ("_nats", "_error_nats")]
    rows = [_row(p, candidates, np.random.default_rng(seed(p.name))) for p in planned]
    table = pd.DataFrame(rows, columns=[*COLUMNS, *names])
    key = "information_candidate_nats" if len(candidates) > 1 else (names or [COLUMNS[0]])[0]
    return table.sort_values(key, ascending=False, kind="stable", ignore_index=True)


def outlook(planned: Planned, fitted: Fitted) -> Outlook:
    """Predict an experiment with a candidate; a draw that fails on one record counts as failed."""
    readings = [fitted.reading(record) for record in planned.records]
    kept = np.logical_and.reduce([ok for _, ok in readings])
    failed = int(np.sum(~kept))
    failure = ""
    if failed:
        record = planned.records[0]
        lost = {n: np.ascontiguousarray(v[~kept]) for n, v in fitted.draws.items()}
        system = fitted.system_for(record)
        failure = system.failure_note(record.excitation, record.coordinate, lost)
    if kept.sum() < 2:  # the density and the sample need one draw each
        return Outlook(Predictive((), (), (kept.size, kept.size)), failure)
    picked = np.flatnonzero(kept)
    cut = max(int(SHARE_FOR_DENSITY * picked.size), 1)
    known, others = (
        tuple(reading.of_draws(part) for reading, _ in readings)
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
        "failed_share": np.mean([o.predictive.failed_share for o in outlooks.values()]),
        "failure": "; ".join(f"{n}: {o.failure}" for n, o in outlooks.items() if o.failure),
        "extrapolation": next(iter(candidates.values())).extrapolation(planned.records[0]),
    }
    if len(candidates) > 1:
        information = candidate_information([o.predictive for o in outlooks.values()], rng)
        row |= {
            "information_candidate_nats": max(information.nats, 0.0),
            "information_candidate_error_nats": information.nats_error,
            "probability_right": information.probability_right,
            "probability_right_error": information.probability_right_error,
        }
    for name, expected in outlooks.items():
        if expected.predictive.known:
            nats, error = parameter_information(expected.predictive)
            row |= {f"information_{name}_nats": nats, f"information_{name}_error_nats": error}
    return row
