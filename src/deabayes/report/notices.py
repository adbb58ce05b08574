"""Warnings of the report: what a reader must know before using its numbers."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from deabayes.figures.noise_share import ALARMING, correlated_shares
from deabayes.figures.results import CandidateResults, PopulationResults, StudyResults
from deabayes.posteriors.sensitivity import MOVED_BY_BOTH, MOVED_BY_PRIOR, SET_BY_PRIOR, in_words
from deabayes.prediction.errors import missed, rejected
from deabayes.quantities import plain, with_unit
from deabayes.sampling.diagnostics import Failed

FAILED_SHARE = 0.001
"""Largest share of failed model evaluations that needs no notice."""
NEAR_THE_BOUND = 0.95
"""Quantile of a correlation length's prior that its posterior median must not pass."""
GATES = (
    ("autocorrelation_times", "length"), ("ess", "ess_bulk_min"), ("ess", "ess_tail_min")
)  # fmt: skip
"""Sampling settings that more steps help to reach, each with the value reached so far."""
MOST_NAMED = 6
REJECTING = "The fitted records reject the model"
TOO_NARROW = "Bands too narrow for held-out records"


@dataclass(frozen=True)
class Notice:
    """One kind of problem in one study; `details` lists its instances in plain words."""

    study: str
    candidate: str
    title: str
    details: tuple[str, ...]
    serious: bool = True


class Check(NamedTuple):
    """A check of a candidate; a notice appears if `details` yields any sentence."""

    title: str
    details: Callable[[CandidateResults], Iterable[str]]
    serious: bool = True


def of_study(results: StudyResults) -> list[Notice]:
    """Notices of a study: all of the recommended candidate, and why others did not converge."""
    best = results.recommended
    notices = [notice for c in results.candidates for notice in unconverged(c)]
    notices += _of_comparison(results)
    for candidate in results.candidates:
        if not candidate.converged and candidate is not best:
            notices += of_candidate(candidate, (FIT_WARNINGS,))
    notices += of_candidate(best)
    if warnings := _record_warnings(results):
        notices.append(Notice(results.name, "", "Data", tuple(warnings), serious=False))
    return notices


def of_candidate(results: CandidateResults, checks: Sequence[Check] | None = None) -> list[Notice]:
    """Notices of one candidate, except convergence; `checks` are all by default."""
    study, name = results.study.name, results.name
    return _notices(study, name, results, CHECKS if checks is None else checks)


def of_population(results: PopulationResults) -> list[Notice]:
    """Notices of a population, including those of its predictions of a new specimen."""
    name, candidate = results.name, str(results.attributes["candidate"])
    notices = []
    if not results.converged:
        reasons = tuple(convergence_reasons(results.new_specimen.convergence, {}))
        title = "Population not converged: do not use these numbers"
        notices.append(Notice(name, candidate, title, reasons))
    notices += _notices(name, candidate, results.new_specimen, PREDICTION_CHECKS)
    if warnings := tuple(str(text) for text in results.attributes.get("warnings") or ()):
        notices.append(Notice(name, candidate, "Specimens and their population", warnings))
    return notices


def _notices(
    study: str, candidate: str, results: CandidateResults, checks: Sequence[Check]
) -> list[Notice]:
    return [
        Notice(study, candidate, check.title, details, check.serious)
        for check in checks
        if (details := tuple(check.details(results)))
    ]


def unconverged(results: CandidateResults) -> list[Notice]:
    """Notice of the convergence gates that failed."""
    if results.converged:
        return []
    reasons = convergence_reasons(results.convergence, results.settings.get("sampling") or {})
    title = "Not converged: do not use these numbers"
    details = tuple(reasons) or ("the posterior file gives no reason",)
    return [Notice(results.study.name, results.name, title, details)]


def convergence_reasons(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> list[str]:
    """One sentence per failed convergence gate, about its worst quantity or run, then advice.

    Parameters
    ----------
    convergence : the attribute `convergence` of a posterior file.
    sampling : the sampling settings; without `max_steps` the advice names no number of steps.
    """
    failures = [Failed(**entry) for entry in convergence.get("failed_gates") or ()]
    by_gate: dict[str, list[Failed]] = defaultdict(list)
    for failure in failures:
        by_gate[failure.gate].append(failure)
    sentences = []
    for same_gate in by_gate.values():
        worst = max(same_gate, key=lambda failure: failure.badness)
        count = f" (the worst of {len(same_gate)})" if len(same_gate) > 1 else ""
        sentences.append(f"{worst.of}: {worst.text}{count}")
    of_gates = {str(failure) for failure in failures}
    reasons = [str(reason) for reason in convergence.get("reasons") or ()]
    sentences += [reason for reason in reasons if reason not in of_gates]
    if any(failure.longer for failure in failures):
        sentences.append(_advice(convergence, sampling))
    return sentences


def _advice(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> str:
    """Advice on the number of steps, from the gates and the values reached so far."""
    limit = sampling.get("max_steps")
    if limit is None or "steps" not in convergence:
        return "Sample longer: double sampling.max_steps"
    lacking = [
        float(sampling[gate]) / float(convergence[reached])
        for gate, reached in GATES
        if gate in sampling and float(convergence.get(reached) or 0.0) > 0.0
    ]
    needed = max([2.0 * float(limit), *(factor * convergence["steps"] for factor in lacking)])
    unit = 10 ** max(int(math.log10(needed)) - 1, 0)
    return (
        f"Sample longer: set sampling.max_steps to {math.ceil(needed / unit) * unit} or more "
        f"(now {limit}). This number follows from the autocorrelation time of the runs so far; "
        "see docs/how-to/not-converged.md"
    )


def _of_comparison(results: StudyResults) -> list[Notice]:
    """Notices of model orders that the data did not decide, and of uncertain evidence."""
    if results.comparison is None:
        return []
    unresolved, uncertain = [], []
    for name, row in results.comparison.iterrows():
        verdict = str(row["verdict"])
        if "not resolved" in verdict:
            differs = row.get("differs_in", "")
            where = f" ({differs})" if isinstance(differs, str) and differs else ""
            unresolved.append(f"{name}: {verdict}{where}")
        if "bridge and nested" in verdict:
            uncertain.append(f"{name}: {verdict}")
    titled = {
        "Model order not resolved by these data": unresolved,
        "Evidence uncertain": uncertain,
    }
    return [
        Notice(results.name, "", title, tuple(texts)) for title, texts in titled.items() if texts
    ]


def leaning(results: CandidateResults) -> Iterator[str]:
    """Parameters at a bound of their prior; their values and others' cannot be trusted."""
    yield from map(str, results.attributes.get("leaning") or ())


def rejecting_records(results: CandidateResults) -> Iterator[str]:
    """Calibration records that reject the candidate although it was fitted to them."""
    if results.errors is not None:
        for _, row in rejected(results.errors).iterrows():
            yield (
                f"{row['experiment']}: the residuals do not follow the noise model "
                f"(p = {row['pit_p']:.1g}), and the 90 % band holds "
                f"{100 * row['coverage_90']:.0f} % of the points. A process may be missing in the "
                "model"
            )


def extrapolation(results: CandidateResults) -> Iterator[str]:
    """Predictions outside the calibrated region, with the records grouped by reason."""
    if results.errors is not None:
        flags = zip(results.errors["experiment"], results.errors["extrapolation"], strict=True)
        yield from _by_reason((name, flag) for name, flag in flags if isinstance(flag, str))


def noise_replaces_physics(results: CandidateResults) -> Iterator[str]:
    """Records in which correlated noise explains more than `ALARMING` of the variance."""
    for name, shares in correlated_shares(results).items():
        if "correlated" in shares and shares["correlated"][1] > ALARMING:
            percent = 100 * shares["correlated"][1]
            size = f"{percent:.0f} %" if percent < 100 else "all"
            yield (
                f"{name}: correlated noise explains {size} of the record's variance. A process may "
                "be missing in the model"
            )


def noise_at_its_bound(results: CandidateResults) -> Iterator[str]:
    """Correlation lengths of the noise whose posterior is at the upper end of the prior."""
    along_grid = results.settings.get("noise_coordinate") == "grid"
    for name in results.names("noise"):
        if name.rpartition(".")[2] != results.noise.length or name not in results.prior:
            continue
        median = float(np.median(results.posterior[name].values))
        if median > np.quantile(results.prior[name].values, NEAR_THE_BOUND):
            length = with_unit(median, results.label(name)["unit"], digits=3)
            shown = f"{median:.3g} points" if along_grid else length
            yield (
                f"{name}: {shown}, at the upper end of its prior. The model's errors last longer: "
                "a process may be missing in the model, and bands may be too narrow"
            )


def noise_for_diagnosis(results: CandidateResults) -> Iterator[str]:
    """Noise models with independent residuals, whose intervals are too narrow."""
    if results.noise.diagnostic_only:
        yield (
            f"{plain(results.noise.name).capitalize()} noise treats residuals as independent: "
            "intervals are too narrow. Use it for diagnosis only"
        )


def set_by_prior(results: CandidateResults) -> Iterator[str]:
    """Material parameters that the prior sets and not the data."""
    if names := _decided_by(results, SET_BY_PRIOR, "material"):
        yield (
            f"{names}: the data removed less than 10 % of the prior's variance. Cite the prior's "
            "source, not this fit"
        )


def moved_by_both(results: CandidateResults) -> Iterator[str]:
    """Material and specimen parameters that are a compromise between prior and data."""
    if names := _decided_by(results, MOVED_BY_BOTH, "material", "specimen"):
        yield (
            f"{names}: a compromise between prior and data. Check whether priors or stated "
            "quantities disagree with the data"
        )


def moved_by_prior(results: CandidateResults) -> Iterator[str]:
    """Material parameters that the data narrowed but that still move with the priors."""
    if names := _decided_by(results, MOVED_BY_PRIOR, "material"):
        yield (
            f"{names}: the remaining uncertainty comes from priors, their own or that of a "
            "quantity such as the thickness. More data of this kind hardly help; a better prior "
            "or an independent measurement does"
        )


def _decided_by(results: CandidateResults, words: str, *kinds: str) -> str:
    """Names of the parameters of these kinds for which the summary has these words."""
    table = results.summary
    if table is None:
        return ""
    names = [name for name in results.names(*kinds) if name in table.index]
    return ", ".join(name for name in names if in_words(table.loc[name]) == words)


def noise_of_other_records(results: CandidateResults) -> Iterator[str]:
    """Records whose noise, or its scale, is taken from other records, grouped by note."""
    predictions = results.predictions.items()
    yield from _by_reason((name, str(p.attrs.get("noise_note", ""))) for name, p in predictions)


def failed_evaluations(results: CandidateResults) -> Iterator[str]:
    """Model evaluations that failed during the fit."""
    counts = results.convergence.get("failures") or {}
    total, failed = counts.get("evaluations", 0), counts.get("failed", 0)
    if total and failed > FAILED_SHARE * total:
        share = f"{100 * failed / total:.2g} %"
        yield f"{failed} of {total} model evaluations failed ({share}); they count as impossible"


def failed_predictions(results: CandidateResults) -> Iterator[str]:
    """Posterior draws that have no response to a record."""
    for name, prediction in results.predictions.items():
        if int(prediction.attrs.get("failed_draws", 0)) > 0:
            failure = prediction.attrs.get("failure") or "some draws have no response"
            yield f"{name}: {failure}; they are left out"


def narrow_bands(results: CandidateResults) -> Iterator[str]:
    """Held-out records that the 90 % predictive band misses."""
    if results.errors is not None:
        for _, row in missed(results.errors).iterrows():
            percent = f"{100 * row['coverage_90']:.0f} %"
            yield f"{row['experiment']}: the 90 % predictive band holds {percent} of the points"


def fit_warnings(results: CandidateResults) -> Iterator[str]:
    """Warnings in the posterior file, except those of records, which stand under `Data`."""
    of_records = set(_record_warnings(results.study))
    for text in results.attributes.get("warnings") or ():
        if text not in of_records:
            yield str(text)


def _record_warnings(results: StudyResults) -> list[str]:
    """Warnings of the preparation about the records."""
    return [f"{e.name}: {text}" for e in results.experiments.values() for text in e.warnings]


def _by_reason(pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Group records with the same reason: ``a, b and 3 more: reason``; empty reasons drop out."""
    records: dict[str, list[str]] = defaultdict(list)
    for name, reason in pairs:
        if reason:
            records[reason].append(name)
    for reason, names in records.items():
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        yield f"{', '.join(names[:MOST_NAMED])}{more}: {reason}"


FIT_WARNINGS = Check("Warnings of the fit", fit_warnings, serious=False)
PREDICTION_CHECKS = (
    Check("Extrapolation: do not rely on the bands", extrapolation),
    Check("Failed model evaluations", failed_evaluations),
    Check("Failed predictions", failed_predictions),
)
"""Checks that apply to predictions of a new specimen too."""
CHECKS = (
    Check("A bound of a prior limits a parameter", leaning),
    Check(REJECTING, rejecting_records),
    *PREDICTION_CHECKS,
    Check("Correlated noise replaces physics that the model lacks", noise_replaces_physics),
    Check("A correlation length of the noise is limited by its prior", noise_at_its_bound),
    Check("Noise model for diagnosis only", noise_for_diagnosis),
    Check("Set by the prior, not by the data", set_by_prior),
    Check("Moved by prior and data", moved_by_both, serious=False),
    Check("Moved by the prior", moved_by_prior, serious=False),
    Check("Noise taken from other records", noise_of_other_records),
    Check(TOO_NARROW, narrow_bands),
    FIT_WARNINGS,
)
