"""Verdicts and proposals of the report."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from deabayes.report import words

NAN = float("nan")


def study(*verdicts, converged=True, compared=True):
    """A study of candidates kv_gm_1, kv_gm_2, ...; the last is recommended."""
    names = [f"kv_gm_{k}" for k in range(1, len(verdicts) + 1)]
    candidates = [SimpleNamespace(name=n, converged=converged, errors=None) for n in names]
    sizes = range(3, 3 + len(names))
    columns = {"verdict": verdicts, "n_parameters": sizes}
    table = pd.DataFrame(columns, index=names) if compared else None
    return SimpleNamespace(candidates=candidates, recommended=candidates[-1], comparison=table)


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (study("not chosen", "chosen: elpd +20"), "Of 2 candidates, use kv_gm_2: elpd +20."),
        (
            study("", "not resolved by these data"),
            "The records do not decide the model order; kv_gm_2 is shown (not resolved by these "
            "data).",
        ),
        (study("", converged=False), "No candidate converged, so use none of them: sample longer."),
        (study(""), "One candidate was fitted, kv_gm_1; there was no order to choose."),
        (
            study("not ranked", "nothing to compare: the only candidate that converged"),
            "Only kv_gm_2 of 2 candidates converged, so no order can be chosen. It is shown, not "
            "recommended.",
        ),
        (
            study("", "", "", compared=False),
            "3 candidates were fitted and not compared; kv_gm_3 is shown.",
        ),
    ],
)
def test_the_verdict_names_the_candidate_to_use(made, expected):
    assert words.verdict(made) == expected


def test_the_verdict_names_fitted_records_that_reject_the_candidate():
    made = study("")
    made.recommended.errors = pd.DataFrame(
        {"experiment": ["a", "b"], "role": "calibrate", "coverage_90": 0.9, "pit_p": [0.5, 1e-9]}
    )
    assert "the records to which it was fitted reject it (b)" in words.verdict(made)


def entry(name, nats, right, failed=0.0, held_out=False, extrapolation=NAN):
    return {
        "experiment": name, "what": f"step {name}", "held_out": held_out,
        "candidates": "kv_gm_1, kv_gm_2", "information_candidate_nats": nats,
        "information_candidate_error_nats": 0.01, "probability_right": right,
        "failed_share": failed, "extrapolation": extrapolation,
    }  # fmt: skip


def proposal(*entries):
    return words.further_sentence(SimpleNamespace(further_experiments=pd.DataFrame(entries)))


def test_the_best_experiment_is_named_with_its_probability():
    text = proposal(
        entry("3 kV", 0.6, 0.93, extrapolation="voltage is higher"), entry("2 kV", 0.5, 0.91)
    )
    assert text == (
        "3 kV (step 3 kV) would be expected to tell kv_gm_1 from kv_gm_2. It would decide rightly "
        "with probability 0.93. It is an extrapolation (voltage is higher)."
    )


def test_an_experiment_that_may_destroy_the_specimen_is_not_proposed():
    text = proposal(entry("5 kV", 0.69, 1.0, failed=0.4), entry("2 kV", 0.5, 0.91))
    assert text.startswith("2 kV")
    text = proposal(entry("5 kV", 0.69, 1.0, failed=0.4), entry("2 kV", 0.01, 0.52))
    assert text.startswith("None of the 2 experiments") and "may not survive" in text


def test_of_equal_experiments_the_measured_one_is_proposed_then_one_in_range():
    far = entry("5 kV", 0.692, 1.0, extrapolation="voltage is higher")
    near, measured = entry("3 kV", 0.690, 1.0), entry("sine", 0.680, 0.99, held_out=True)
    assert proposal(far, near).startswith("3 kV")
    assert proposal(far, near, measured).startswith("The held-out record sine")
    assert proposal(far, near | {"information_candidate_nats": 0.6}).startswith("5 kV")


def test_an_uncertain_or_uninformative_experiment_is_not_promised():
    text = proposal(entry("sine", 0.2, 0.75, held_out=True))
    assert text == (
        "The only experiment considered would not surely tell kv_gm_1 from kv_gm_2. The best is "
        "the held-out record sine (step sine): it would decide rightly with probability 0.75 (0.50 "
        "is guessing)."
    )
    text = proposal(entry("sine", 0.019, 0.55))
    assert text == (
        "The only experiment considered would not be expected to tell kv_gm_1 from kv_gm_2."
    )


def test_there_is_no_proposal_for_one_candidate_or_without_a_table():
    assert proposal(entry("3 kV", NAN, NAN) | {"candidates": "kv_gm_1"}) == ""
    assert words.further_sentence(SimpleNamespace(further_experiments=None)) == ""
