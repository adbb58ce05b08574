"""Notices of the report: what a reader must know before trusting its numbers."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.posteriors.sensitivity import MOVED_BY_BOTH, MOVED_BY_PRIOR, SET_BY_PRIOR, in_words
from deabayes.prediction.errors import missed, rejected
from deabayes.quantities import plain, with_unit
from deabayes.sampling.diagnostics import Failed


def grouped(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> list[str]:
    """One sentence per failed convergence gate, about its worst quantity or run, then advice.

    Parameters
    ----------
    convergence : the attribute `convergence` of a posterior file.
    sampling : the sampling settings; without `max_steps` the advice names no number of steps.
    """
    failed = [Failed(**each) for each in convergence.get("failed_gates") or ()]
    gates: dict[str, list[Failed]] = defaultdict(list)
    for each in failed:
        gates[each.gate].append(each)
    of_gates = {str(each) for each in failed}
    others = [str(each) for each in convergence.get("reasons") or () if str(each) not in of_gates]
    advice = [_advice(convergence, sampling)] if any(each.longer for each in failed) else []
    return [*(_worst(each) for each in gates.values()), *others, *advice]


def _worst(failed: list[Failed]) -> str:
    worst = max(failed, key=lambda each: each.badness)
    many = f" (the worst of {len(failed)})" if len(failed) > 1 else ""
    return f"{worst.of}: {worst.text}{many}"


def _advice(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> str:
    """Advice on the number of steps, from the gates and the values reached so far."""
    limit = sampling.get("max_steps")
    if limit is None or "steps" not in convergence:
        return "Sample longer: double sampling.max_steps"
    gates = (
        ("autocorrelation_times", "length"),
        ("ess", "ess_bulk_min"),
        ("ess", "ess_tail_min"),
    )
    lacking = [
        float(sampling[gate]) / float(convergence[reached])
        for gate, reached in gates
        if gate in sampling and float(convergence.get(reached) or 0.0) > 0.0
    ]
    needed = max([2.0 * float(limit), *(each * convergence["steps"] for each in lacking)])
    return (
        f"Sample longer: set sampling.max_steps to {_rounded_up(needed)} or more (now {limit}), by "
        "what the runs tell so far of their autocorrelation time; docs/how-to/not-converged.md"
    )


def _rounded_up(steps: float) -> int:
    unit = 10 ** max(int(math.log10(steps)) - 1, 0)
    return math.ceil(steps / unit) * unit


FAILED_SHARE = 0.001
NEAR_THE_BOUND = 0.95
"""Quantile of a correlation length's prior that its posterior median must not pass."""


@dataclass(frozen=True)
class Notice:
    """One kind of problem in one study; `details` lists its instances in plain words."""

    study: str
    candidate: str
    title: str
    details: tuple[str, ...]
    serious: bool = True


def of_study(results: StudyResults) -> list[Notice]:
    """Notices of a study: all of the recommended candidate, and why others did not converge."""
    found = [n for c in results.candidates for n in unconverged(c)]
    found += unresolved(results)
    found += evidence(results)
    for candidate in results.candidates:
        if not candidate.converged and candidate is not results.recommended:
            found += stored(candidate)
    found += of_candidate(results.recommended)
    found += data(results)
    return found


def of_candidate(results: CandidateResults) -> list[Notice]:
    """Notices of one candidate, except convergence."""
    return [notice for check in CHECKS for notice in check(results)]


def unconverged(results: CandidateResults) -> Iterator[Notice]:
    """Notice of the convergence gates that failed."""
    if not results.converged:
        reasons = grouped(results.convergence, results.settings.get("sampling") or {})
        yield _notice(
            results, "Not converged: do not use these numbers", reasons or ["no reason was stored"]
        )


def unresolved(results: StudyResults) -> Iterator[Notice]:
    """Notice of a comparison of model orders that the data did not decide."""
    table = results.comparison
    if table is None:
        return
    open_cases = table[table["verdict"].astype(str).str.contains("not resolved")]
    details = []
    for name, row in open_cases.iterrows():
        differs = row.get("differs_in", "")
        extra = f" ({differs})" if isinstance(differs, str) and differs else ""
        details.append(f"{name}: {row['verdict']}{extra}")
    if details:
        yield Notice(results.name, "", "Model order not resolved by these data", tuple(details))


def evidence(results: StudyResults) -> Iterator[Notice]:
    """Candidates for which bridge sampling and nested sampling disagree on the evidence."""
    table = results.comparison
    if table is None:
        return
    verdicts = table["verdict"].astype(str)
    details = [f"{n}: {v}" for n, v in verdicts.items() if "bridge and nested" in v]
    if details:
        yield Notice(results.name, "", "Evidence uncertain", tuple(details))


def leaning(results: CandidateResults) -> Iterator[Notice]:
    """Parameters at a bound of their prior; their values and others' cannot be trusted."""
    details = [str(text) for text in results.attributes.get("leaning") or []]
    if details:
        yield _notice(results, "A prior's bound decides", details)


def not_adequate(results: CandidateResults) -> Iterator[Notice]:
    """Calibration records that reject the candidate although it was fitted to them."""
    if results.errors is None:
        return
    details = [
        f"{row['experiment']}: its residuals are not those of the noise model (p = "
        f"{row['pit_p']:.1g}), the 90 % band holds {100 * row['coverage_90']:.0f} % of it"
        for _, row in rejected(results.errors).iterrows()
    ]
    if details:
        yield _notice(results, "The records that were fitted reject the model", details)


def extrapolation(results: CandidateResults) -> Iterator[Notice]:
    """Predictions outside the calibrated region, with the records grouped by reason."""
    if results.errors is None:
        return
    by_reason: dict[str, list[str]] = defaultdict(list)
    for _, row in results.errors.iterrows():
        if isinstance(row["extrapolation"], str) and row["extrapolation"]:
            by_reason[row["extrapolation"]].append(str(row["experiment"]))
    details = [f"{_listed(names)}: {reason}" for reason, names in by_reason.items()]
    if details:
        yield _notice(results, "Extrapolation: bands are not to be relied on", details)


def noise_took_physics(results: CandidateResults) -> Iterator[Notice]:
    """Records in which correlated noise explains more than `ALARMING` of the variance."""
    from deabayes.figures.noise_share import ALARMING, correlated_shares

    details = []
    for name, shares in correlated_shares(results).items():
        if "correlated" in shares and shares["correlated"][1] > ALARMING:
            percent = 100 * shares["correlated"][1]
            size = f"{percent:.0f} %" if percent < 100 else "all"
            details.append(f"{name}: correlated noise explains {size} of the record's variance")
    if details:
        yield _notice(results, "The noise model takes what the physics lacks", details)


def noise_at_its_bound(results: CandidateResults) -> Iterator[Notice]:
    """Correlation lengths of the noise whose posterior is at the upper end of the prior."""
    details = []
    along_grid = results.settings.get("noise_coordinate") == "grid"
    for name in results.names("noise"):
        if name.rpartition(".")[2] != results.noise.length or name not in results.prior:
            continue
        prior, found = results.prior[name].values, results.posterior[name].values
        if np.median(found) > np.quantile(prior, NEAR_THE_BOUND):
            middle = float(np.median(found))
            length = with_unit(middle, results.label(name)["unit"], digits=3)
            shown = f"{middle:.3g} points" if along_grid else length
            details.append(
                f"{name}: {shown}, at the upper end of its prior. The model's errors last "
                "longer: a process may be missing, and bands may be too narrow"
            )
    if details:
        yield _notice(results, "The noise is cut short by its prior", details)


def noise_diagnostic_only(results: CandidateResults) -> Iterator[Notice]:
    """Noise models with independent residuals, whose intervals are too narrow."""
    if results.noise.diagnostic_only:
        text = "residuals are treated as independent: intervals are too narrow, diagnostic only"
        title = f"{plain(results.noise.name).capitalize()} noise"
        yield _notice(results, title, [text])


def set_by_prior(results: CandidateResults) -> Iterator[Notice]:
    """Material parameters that the prior sets and not the data."""
    if weak := _decided_by(results, SET_BY_PRIOR, "material"):
        text = f"{', '.join(weak)}: less than 10 % of the prior's variance was removed by the data"
        yield _notice(results, "Set by the prior, not by the data", [text])


def moved_by_both(results: CandidateResults) -> Iterator[Notice]:
    """Material and specimen parameters that are a compromise between prior and data."""
    if names := _decided_by(results, MOVED_BY_BOTH, "material", "specimen"):
        text = (
            f"{', '.join(names)}: a compromise, more weight on either moves the number; "
            "see whether priors or stated quantities disagree with the data"
        )
        yield _notice(results, "Moved by prior and data", [text], serious=False)


def moved_by_prior(results: CandidateResults) -> Iterator[Notice]:
    """Material parameters that the data narrowed but that still move with the priors."""
    if names := _decided_by(results, MOVED_BY_PRIOR, "material"):
        text = (
            f"{', '.join(names)}: the remaining uncertainty comes from priors, its own or that of "
            "a quantity such as the thickness; more data of this kind hardly help"
        )
        yield _notice(results, "Moved by the prior", [text], serious=False)


def _decided_by(results: CandidateResults, words: str, *kinds: str) -> list[str]:
    table = results.summary
    if table is None:
        return []
    names = [n for n in results.names(*kinds) if n in table.index]
    return [n for n in names if in_words(table.loc[n]) == words]


def carried_over_noise(results: CandidateResults) -> Iterator[Notice]:
    """Records whose noise, or its scale, is taken from other records, grouped by note."""
    by_note: dict[str, list[str]] = defaultdict(list)
    for name, prediction in results.predictions.items():
        if note := str(prediction.attrs.get("noise_note", "")):
            by_note[note].append(name)
    details = [f"{_listed(names)}: {note}" for note, names in by_note.items()]
    if details:
        yield _notice(results, "Noise taken from other records", details)


def failures(results: CandidateResults) -> Iterator[Notice]:
    """Model evaluations that failed, and posterior draws that could not be predicted."""
    counted = results.convergence.get("failures") or {}
    total, failed = counted.get("evaluations", 0), counted.get("failed", 0)
    if total and failed > FAILED_SHARE * total:
        text = f"{failed} of {total} model evaluations failed ({100 * failed / total:.2g} %)"
        yield _notice(results, "Failed model evaluations", [text])
    details = [
        f"{name}: {prediction.attrs.get('failure') or 'draws without a response'}; left out"
        for name, prediction in results.predictions.items()
        if int(prediction.attrs.get("failed_draws", 0)) > 0
    ]
    if details:
        yield _notice(results, "Failed predictions", details)


def narrow_bands(results: CandidateResults) -> Iterator[Notice]:
    """Held-out records that the 90 % predictive band misses."""
    if results.errors is None:
        return
    details = [
        f"{row['experiment']}: the 90 % predictive band holds {100 * row['coverage_90']:.0f} %"
        for _, row in missed(results.errors).iterrows()
    ]
    if details:
        yield _notice(results, "Bands too narrow for held-out records", details)


def stored(results: CandidateResults) -> Iterator[Notice]:
    """Warnings in the posterior file, except those of records, which `data` reports."""
    texts = results.attributes.get("warnings") or []
    of_records = set(_of_records(results.study))
    details = [str(text) for text in texts if text not in of_records]
    if details:
        yield _notice(results, "Warnings of the fit", details, serious=False)


def data(results: StudyResults) -> Iterator[Notice]:
    """Warnings of the preparation about the records."""
    details = _of_records(results)
    if details:
        yield Notice(results.name, "", "Data", tuple(details), serious=False)


def _of_records(results: StudyResults) -> list[str]:
    return [f"{e.name}: {text}" for e in results.experiments.values() for text in e.warnings]


def _notice(
    results: CandidateResults, title: str, details: list[str], serious: bool = True
) -> Notice:
    return Notice(results.study.name, results.name, title, tuple(details), serious)


def _listed(names: list[str], most: int = 6) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


CHECKS: tuple[Callable[[CandidateResults], Iterator[Notice]], ...] = (
    leaning,
    not_adequate,
    extrapolation,
    noise_took_physics,
    noise_at_its_bound,
    noise_diagnostic_only,
    set_by_prior,
    moved_by_both,
    moved_by_prior,
    carried_over_noise,
    failures,
    narrow_bands,
    stored,
)
