"""Sentences of the report, except its notices: verdicts, proposals, fixed text and the glossary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from deabayes.comparison.verdicts import NOT_RANKED
from deabayes.figures.noise_share import sizes
from deabayes.figures.results import StudyResults
from deabayes.prediction.errors import MOST_NAMED, missed, rejected
from deabayes.quantities import significant

SURE, MAY_FAIL = 0.9, 0.01
"""Probability of deciding rightly above which an experiment is said to decide, and share of draws
without a response above which an experiment is not proposed."""
ROUNDING = 0.005
"""Difference in nats that is ignored."""
SMALL_GAIN = 1.0
"""Share of the range [%] that an order explains, below which a smooth error may look the same."""

LEAD = (
    "Records are fitted with candidate models. Every number has its uncertainty. Models are tested "
    "on records that were held out of the fit, if there are any."
)
UNFINISHED = (
    "Jobs failed. This page shows the results that do not depend on them. Correct the causes below "
    "and run the same command again: it continues from here."
)
NO_WARNINGS = "Every fit converged, and no prediction leaves the calibrated range."
NO_RESULTS = "No results: this study depends on a job that failed."
GLOSSARY = {
    "Prior, posterior": (
        "What was considered possible before the data, and after them. If a wide prior became a "
        "narrow posterior, the data determined the number."
    ),
    "Median [5 %, 95 %]": (
        "The middle of the posterior and the interval that holds 90 % of it. If the model is "
        "right, the number lies in the interval with 90 % probability."
    ),
    "Parameter band": (
        "Where the model's curve lies, given what is known about its parameters. New data do not "
        "fall into this band, because they have noise."
    ),
    "Discrepancy band": (
        "The parameter band widened by the systematic error of the model, a slowly varying error "
        "that is estimated from the residuals."
    ),
    "Predictive band": (
        "The discrepancy band widened by sensor noise: where a new reading falls with the stated "
        "probability. Compare data with this band only."
    ),
    "Coverage": (
        "The share of readings inside a predictive band. A 90 % band should hold about 90 %. If "
        "it holds much less, the prediction is too certain."
    ),
    "Held-out record": (
        "A record that was not fitted. Its errors show how well the model predicts; errors of "
        "calibration records show only how well it fits."
    ),
    "e<sub>rms</sub>, e<sub>m</sub>": (
        "Root-mean-square and largest error of the median curve, in per cent of the record's "
        "range. The brackets hold the errors of the posterior's curves. The median curve may lie "
        "closer to a record than most of them, and its error is then below the bracket."
    ),
    "CRPS": (
        "Average distance between prediction and reading, in the response's unit. It also rewards "
        "bands of the right width. Smaller is better."
    ),
    "Points fall (PIT)": (
        "Whether each point falls where the prediction expects it, given the points before it. "
        "The p-value tests whether the probability integral transforms are uniform. Below 0.05 "
        "they are not: the predicted spread is too narrow or too wide, or readings lie to one "
        "side, as the figure of the transforms shows. In a long record the error may be too small "
        "to matter. The test is too mild for fitted records."
    ),
    "Contraction": (
        "The share of the prior's variance that the data removed. Below 10 %, and if the data do "
        "not move the number either, the prior sets it: cite the prior's source, not this fit. A "
        "negative value means that the number is less certain than before, because the "
        "uncertainty of other parameters was added."
    ),
    "Moved by prior / data": (
        "How far the number moves when the priors, or the data, get a little more weight "
        "(power-scaling sensitivity). Values up to 0.05 are negligible: doubling the weight would "
        "shift the number, and change its width, by less than about a quarter of its standard "
        "deviation. “Not known”: there are too few draws to tell."
    ),
    "Moved by the prior": (
        "The data narrowed the number, but it follows the priors and hardly the data. The prior "
        "may be its own or that of another parameter, such as a thickness. A better prior or an "
        "independent measurement improves the number; more data of this kind do not."
    ),
    "Moved by prior and data": (
        "More weight on the priors moves the number one way, more weight on the data the other: "
        "it is a compromise. This is right if both are about equally informative. If the data "
        "should be better, check the prior, the stated quantities of the specimen, and the model."
    ),
    "Correlated noise (OU)": (
        "Readings close in time have similar errors. Treating them as independent makes intervals "
        "far too narrow. σ<sub>OU</sub> is the size of that error, τ<sub>OU</sub> its duration. "
        "If correlated noise is much of a record, the model lacks physics."
    ),
    "R-hat": (
        "Compares independent runs of the sampler. It is 1.00 if they agree. Above 1.01 they "
        "disagree, and the numbers must not be used."
    ),
    "Effective sample size (ESS)": (
        "Number of independent draws that are worth as much as the correlated draws, for the "
        "middle (bulk) and the ends (tails) of an interval. At least 400 of each."
    ),
    "Log evidence": (
        "Log probability of the data under a candidate, averaged over its prior. Differences of "
        "more than a few units count."
    ),
    "elpd": (
        "Expected log predictive density: how well a candidate predicts parts of the records "
        "(blocks) or whole records that were left out. No record is left out if it is the only one"
        " or if the candidate is more than 50 nats behind. A dash may also mean that the evidence "
        "without some record is not known to half a nat. Larger is better. A difference over "
        "blocks counts if it exceeds 4 and twice its standard error. It also counts if it exceeds "
        "8 and, without the block that gains most, 4 and its standard error. The first and the "
        "last block of a record do not count: they show how a candidate extrapolates."
    ),
    "Further experiment": (
        "What the data of an experiment are expected to tell, if one of the remaining candidates "
        "is right and its parameters follow its posterior. “Decides rightly”: how often its data "
        "would name the right candidate. A repeated record counts as if the model's own error "
        "were drawn anew, which makes it look better than it is."
    ),
    "Nat": (
        "Unit of information: an answer of one nat makes something e = 2.7 times as probable. "
        "Naming one of two equally probable candidates with certainty gives 0.69 nats."
    ),
    "k-hat": (
        "Reliability of the weights that leave a block out; smaller is better. For a block above "
        "0.5, the posterior without it was sampled instead."
    ),
    "Extrapolation": (
        "A prediction outside the calibration records: beyond their range of excitation or held "
        "conditions (a load, a bias), 1.5 times as long, or 1.5 times as fast. No statistics can "
        "guarantee it."
    ),
    "Simulated data": (
        "Produced by a computer model, not measured. Such studies test the method, not a material."
    ),
}
"""Term -> its meaning, as HTML."""
GLOSSARY_OF_POPULATIONS = {
    "Population, spread": (
        "Specimens of one material scatter about a mean. The spread is the standard deviation "
        "between them, or that of the logarithm for a positive parameter: 10 % means that "
        "specimens differ by about a tenth."
    ),
    "Shrinkage": (
        "The share by which the other specimens replace a specimen's own records: 0 % if its own "
        "records decide alone, 100 % if they say nothing."
    ),
    "Tail probability": (
        "How far a specimen lies from the others. Below 0.005 it may not belong to them."
    ),
}


def verdict(study: StudyResults) -> str:
    """State which candidate to use, and which checks of the records it fails."""
    choice = " ".join(filter(None, (_choice(study), _cost_of_smaller(study), _small_gain(study))))
    failing = [check.text for check in checks(study) if check.failed]
    return " ".join([choice, *(f"But {text[0].lower()}{text[1:]}." for text in failing)])


class Outcome(NamedTuple):
    """A check of the recommended candidate: its outcome in words, and whether it failed."""

    text: str
    failed: bool


def checks(study: StudyResults) -> list[Outcome]:
    """Outcomes of the two checks that a model must pass: on fitted and on held-out records.

    No other words of the report may call a model good if one of them failed.
    """
    errors = study.recommended.errors
    if errors is None:
        return []
    by_role = {role: errors[errors["role"] == role] for role in ("calibrate", "validate")}
    fitted, held_out = by_role["calibrate"], by_role["validate"]
    return _check_fitted(fitted, rejected(errors)) + _check_held_out(held_out, missed(errors))


def _check_fitted(fitted: pd.DataFrame, bad: pd.DataFrame) -> list[Outcome]:
    if fitted.empty:
        return []
    if bad.empty:
        return [Outcome(f"No fitted record ({len(fitted)}) rejects the model", False)]
    one = len(fitted) == 1
    who = "The fitted record rejects" if one else f"{_some(bad, fitted)} fitted records reject"
    text = (
        f"{who} the model ({_named(bad)}): it lacks something, and parameters may be off by more "
        "than their intervals say"
    )
    return [Outcome(text, True)]


def _check_held_out(held_out: pd.DataFrame, bad: pd.DataFrame) -> list[Outcome]:
    if held_out.empty:
        return [Outcome("No record was held out, so predictions are not tested", False)]
    outcomes = []
    known = held_out["coverage_90"].dropna()
    if len(known) < len(held_out):
        unknown = held_out.drop(known.index)
        text = f"{_some(unknown, held_out)} held-out records have no band ({_named(unknown)})"
        outcomes.append(Outcome(text, True))
    if not bad.empty:
        text = f"The 90 % band is too narrow for {_some(bad, held_out)} held-out records"
        outcomes.append(Outcome(f"{text} ({_named(bad)})", True))
    elif len(known):
        low, high = (f"{100 * known.agg(end):.0f}" for end in ("min", "max"))
        share = f"{low} %" if low == high else f"{low} to {high} %"
        text = f"The 90 % band holds {share} of the points of held-out records ({len(known)})"
        outcomes.append(Outcome(text, False))
    return outcomes


def _some(bad: pd.DataFrame, every: pd.DataFrame) -> str:
    return f"{len(bad)} of {len(every)}"


def _named(rows: pd.DataFrame) -> str:
    names = list(rows["experiment"])
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def headline(study: StudyResults) -> tuple[str, list[str]]:
    """Return what to use in a few words, and how sure that is, clause by clause.

    The clauses also say what the smaller order costs and, if the order is not resolved, which
    experiment would settle it.
    """
    best, count = study.recommended.name, len(study.candidates)
    if not any(candidate.converged for candidate in study.candidates):
        return "No candidate converged", ["sample longer; use none of these numbers"]
    if study.comparison is None and count > 1:
        return f"{best}, not compared", [f"{count} candidates were fitted and not compared"]
    if study.comparison is None or count < 2:
        return best, ["the only candidate"]
    text = str(study.comparison["verdict"].get(best, "not compared"))
    clauses = text.removeprefix("chosen: ").split("; ")
    clauses += filter(None, [f(study).rstrip(".") for f in (_cost_of_smaller, _small_gain)])
    if text.startswith("nothing to compare"):
        return f"{best}, not recommended", ["the only candidate that converged"]
    if text.startswith("not resolved"):
        settles = further_sentence(study).rstrip(".")
        return f"Order not resolved, {best} meanwhile", [*clauses, *filter(None, [settles])]
    if any(check.failed for check in checks(study)):
        return f"{best}, best of {count}", clauses
    return f"Use {best}", clauses


def _choice(study: StudyResults) -> str:
    """One sentence on which candidate to use."""
    best, count = study.recommended, len(study.candidates)
    if not any(candidate.converged for candidate in study.candidates):
        return "No candidate converged, so use none of them: sample longer."
    if study.comparison is None and count > 1:
        return f"{count} candidates were fitted and not compared; {best.name} is shown."
    if study.comparison is None or count < 2:
        return f"One candidate was fitted, {best.name}; there was no order to choose."
    text = str(study.comparison["verdict"].get(best.name, "not compared"))
    if text.startswith("nothing to compare"):
        return (
            f"Only {best.name} of {count} candidates converged, so no order can be chosen. "
            "It is shown, not recommended."
        )
    if text.startswith("not resolved"):
        return f"The records do not decide the model order; {best.name} is shown ({text})."
    if any(check.failed for check in checks(study)):
        return f"Of {count} candidates, {best.name} is best: {text.removeprefix('chosen: ')}."
    return f"Of {count} candidates, use {best.name}: {text.removeprefix('chosen: ')}."


def _next_smaller(study: StudyResults) -> tuple[str, pd.DataFrame, pd.DataFrame] | None:
    """Name of the next smaller candidate, its errors, and those of the shown candidate.

    None if no smaller candidate was ranked, or if errors are not known.
    """
    table = study.comparison
    if table is None or study.recommended.name not in table.index:
        return None
    unranked = table["verdict"].astype(str).str.startswith(NOT_RANKED)
    ranked = table[~unranked].sort_values("n_parameters")
    names = list(ranked.index)
    if study.recommended.name not in names[1:]:
        return None
    smaller = names[names.index(study.recommended.name) - 1]
    results = {candidate.name: candidate.errors for candidate in study.candidates}
    mine, theirs = results.get(study.recommended.name), results.get(smaller)
    return None if mine is None or theirs is None else (smaller, theirs, mine)


def _cost_of_smaller(study: StudyResults) -> str:
    """Compare the errors of the shown candidate with those of the next smaller one."""
    compared = _next_smaller(study)
    if compared is None:
        return ""
    smaller, theirs, mine = compared
    parts = [
        f"{_mean_error(theirs, role)} instead of {_mean_error(mine, role)} on {words} records"
        for role, words in (("calibrate", "the fitted"), ("validate", "the held-out"))
        if (mine["role"] == role).any() and (theirs["role"] == role).any()
    ]
    return f"With {smaller}, e_rms is {', and '.join(parts)}." if parts else ""


def explained(theirs: float, mine: float) -> float:
    """What one candidate explains beyond another: sqrt(theirs - mine), of mean square errors."""
    return math.sqrt(max(theirs - mine, 0.0))


def _small_gain(study: StudyResults) -> str:
    """Warn if what the shown candidate explains beyond the next smaller one is little."""
    compared = _next_smaller(study)
    if compared is None:
        return ""
    smaller, *both = compared
    theirs, mine = (errors[errors["role"] == "calibrate"]["e_rms_percent"] for errors in both)
    gain = explained(float((theirs**2).mean()), float((mine**2).mean()))
    if not 0.0 < gain < SMALL_GAIN:
        return ""
    return (
        f"Beyond {smaller} it explains {significant(gain, 2)} % of the range of the fitted "
        "records: a smooth error as small, in model or sensor, would look the same."
    )


def _mean_error(errors: pd.DataFrame, role: str) -> str:
    """Mean rms error over the records of a role, with its interval, in per cent."""
    rows = errors[errors["role"] == role]
    mean, low, high = (
        significant(float(rows[column].mean()), 2)
        for column in ("e_rms_percent", "e_rms_q05", "e_rms_q95")
    )
    return f"{mean} % [{low}, {high}]"


def may_hide(study: StudyResults) -> str:
    """State how large a further unit may be and still be hidden in correlated noise.

    Empty if nothing is compared, or if correlated noise is nowhere larger than white noise.
    """
    if study.comparison is None or len(study.comparison) < 2:
        return ""
    by_record = sizes(study.recommended)
    above = {
        name: parts["correlated"]
        for name, parts in by_record.items()
        if parts.get("correlated", 0.0) > parts.get("white", 0.0)
    }
    if not above:
        return ""
    name = max(above, key=lambda record: above[record])
    white = by_record[name].get("white", 0.0)
    beside = f", beside white noise of {significant(100 * white, 2)} %" if white else ""
    most = ", the most of its records" if len(by_record) > 1 else ""
    return (
        f"Correlated noise takes what {study.recommended.name} leaves: "
        f"{significant(100 * above[name], 2)} % of the range in {name}{most}{beside}. A further "
        "unit that adds less than that may be hidden in it. The verdict says which units these "
        "records need, not that there are no others."
    )


def further_sentence(study: StudyResults) -> str:
    """Propose the best further experiment; empty unless there are several candidates.

    A held-out record is not proposed, because it was already measured. If it would tell the
    candidates apart, the sentence says to fit it.
    """
    table = study.further_experiments
    names = [] if table is None else str(table["candidates"].iloc[0]).split(", ")
    if table is None or len(names) < 2:
        return ""
    held_out = table["held_out"].astype(bool)
    return " ".join(
        filter(None, (_to_fit(table[held_out], names), _to_do(table[~held_out], names)))
    )


def _among(names: Sequence[str]) -> str:
    """Name the candidates to tell apart: ``a from b and c``."""
    others = names[1] if len(names) == 2 else f"{', '.join(names[1:-1])} and {names[-1]}"
    return f"{names[0]} from {others}"


def _informative(table: pd.DataFrame) -> pd.Series:
    nats = table["information_candidate_nats"]
    return nats > 2.0 * table["information_candidate_error_nats"]


def _to_fit(held_out: pd.DataFrame, names: Sequence[str]) -> str:
    """Name the held-out record that would tell the candidates apart; empty if none would."""
    telling = held_out[_informative(held_out)]
    if telling.empty:
        return ""
    best = _preferred(telling)
    return (
        f"To tell {_among(names)}, the most telling record that is held out is "
        f"{best['experiment']}. You have it: move it to `calibrate`. It would decide rightly with "
        f"probability {best['probability_right']:.2f} ({1.0 / len(names):.2f} is guessing), but no "
        "longer test predictions."
    )


def _to_do(table: pd.DataFrame, names: Sequence[str]) -> str:
    """Propose an experiment that was not done yet, or say that none of them would decide."""
    if table.empty:
        return ""
    question = f"tell {_among(names)}"
    several = f"None of the {len(table)} further experiments considered would"
    none = several if len(table) > 1 else "The only further experiment considered would not"
    informative, safe = _informative(table), table["failed_share"] <= MAY_FAIL
    if not (informative & safe).any():
        risky = informative & ~safe
        but = ", except some that the specimen may not survive" if risky.any() else ""
        return f"{none} be expected to {question}{but}."
    best = _preferred(table[informative & safe])
    name = f"{best['experiment']} ({best['what']})"
    probability = f"{best['probability_right']:.2f}"
    flag = best["extrapolation"]
    caution = f" It is an extrapolation ({flag})." if isinstance(flag, str) and flag else ""
    if best["probability_right"] < SURE:
        return (
            f"{none} surely {question}. The best is {name}: it would decide rightly with "
            f"probability {probability} ({1.0 / len(names):.2f} is guessing).{caution}"
        )
    return (
        f"{name} would be expected to {question}. It would decide rightly with probability "
        f"{probability}.{caution}"
    )


def _preferred(table: pd.DataFrame) -> pd.Series:
    """Choose among the experiments that are as informative as the best one, within errors.

    One inside the calibrated range comes first.
    """
    nats, error = table["information_candidate_nats"], table["information_candidate_error_nats"]
    margin = np.maximum(2.0 * np.hypot(error, error.iloc[0]), ROUNDING)
    equal = table[nats >= nats.iloc[0] - margin]
    outside = equal["extrapolation"].map(lambda flag: isinstance(flag, str) and bool(flag))
    return equal.loc[outside.sort_values(kind="stable").index[0]]
