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
    return SimpleNamespace(
        candidates=candidates,
        recommended=candidates[-1],
        comparison=table,
        further_experiments=None,
    )


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


ROLES = ("calibrate", "calibrate", "validate")


def errors(coverage, p_values):
    return pd.DataFrame(
        {"experiment": ["a", "b", "c"], "role": ROLES, "coverage_90": coverage, "pit_p": p_values}
    )


PASSED = errors([0.9, 0.8, 0.75], [0.5, 0.2, 1e-9])
REJECTED = errors([0.9, 0.9, 0.9], [0.5, 1e-9, 0.5])
MISSED = errors([0.9, 0.9, 0.69], [0.5, 0.5, 0.5])


@pytest.mark.parametrize(
    ("table", "title", "verdict", "failed"),
    [
        (PASSED, "Use kv_gm_2", "use kv_gm_2", []),
        (
            REJECTED,
            "kv_gm_2, best of 2",
            "But 1 of 2 fitted records reject the model (b)",
            ["1 of 2 fitted records reject the model (b)"],
        ),
        (
            MISSED,
            "kv_gm_2, best of 2",
            "But the 90 % band is too narrow for 1 of 1 held-out records (c).",
            ["The 90 % band is too narrow for 1 of 1 held-out records (c)"],
        ),
    ],
)
def test_a_candidate_is_to_be_used_only_if_its_records_pass(table, title, verdict, failed):
    made = study("not chosen", "chosen: the smallest; odds 20 to 1")
    made.recommended.errors = table
    assert words.headline(made) == (title, ["the smallest", "odds 20 to 1"])
    assert verdict in words.verdict(made)
    assert ("use kv_gm_2" in words.verdict(made)) == (not failed)
    found = [check.text for check in words.checks(made) if check.failed]
    assert [text.partition(":")[0] for text in found] == failed


def test_checks_that_were_passed_say_how_far_they_go():
    made = study("")
    made.recommended.errors = PASSED
    assert words.checks(made) == [
        ("No fitted record (2) rejects the model", False),
        ("The 90 % band holds 75 % of the points of held-out records (1)", False),
    ]
    made.recommended.errors = PASSED.assign(role="validate")
    (held_out,) = words.checks(made)
    assert held_out.text == "The 90 % band holds 75 to 90 % of the points of held-out records (3)"
    made.recommended.errors = PASSED.assign(coverage_90=[0.9, 0.9, NAN])
    assert words.checks(made)[1] == ("1 of 1 held-out records have no band (c)", True)
    made.recommended.errors = PASSED[:1]
    assert words.checks(made)[1].text == "No record was held out, so predictions are not tested"
    made.recommended.errors = REJECTED[1:2]
    assert words.checks(made)[0].text.startswith("The fitted record rejects the model (b)")


@pytest.mark.parametrize(
    ("made", "title", "how_sure"),
    [
        (study("", converged=False), "No candidate converged", "sample longer; use none of these"),
        (study("", "", compared=False), "kv_gm_2, not compared", "2 candidates were fitted and"),
        (study(""), "kv_gm_1", "the only candidate"),
        (study("", "nothing to compare: x"), "kv_gm_2, not recommended", "the only candidate that"),
        (
            study("", "not resolved by these data against a"),
            "Order not resolved, kv_gm_2 meanwhile",
            "not resolved",
        ),
    ],
)
def test_headlines_of_undecided_studies(made, title, how_sure):
    found, clauses = words.headline(made)
    assert found == title and clauses[0].startswith(how_sure)


def test_the_headline_says_what_the_smaller_order_costs_and_what_would_settle_it():
    made = study("not resolved", "not resolved by these data against kv_gm_1")
    columns = {"role": ["calibrate"], "coverage_90": 0.9, "pit_p": 0.5, "experiment": "a"}
    for candidate, size in zip(made.candidates, (8.0, 2.0), strict=True):
        rms = {"e_rms_percent": size, "e_rms_q05": 0.5 * size, "e_rms_q95": 2 * size}
        candidate.errors = pd.DataFrame(columns | rms)
    made.further_experiments = pd.DataFrame([entry("long", 0.5, 0.95)])
    _, (_, cost, settles) = words.headline(made)
    assert cost.endswith(
        "e_rms is 8.0 % [4.0, 16] instead of 2.0 % [1.0, 4.0] on the fitted records"
    )
    assert settles.startswith("long (step long) would be expected to tell kv_gm_1 from kv_gm_2")
    made.comparison["verdict"] = ["not chosen", "chosen: x"]
    assert words.headline(made)[1] == ["x", cost]


@pytest.mark.parametrize(
    ("theirs", "mine", "said"), [(1.0, 0.6, "0.80 %"), (1.3, 0.6, ""), (1, 1, "")]
)
def test_an_order_that_explains_little_comes_with_a_caution(theirs, mine, said):
    made = study("not chosen", "chosen: x")
    for candidate, size in zip(made.candidates, (theirs, mine), strict=True):
        rms = {"e_rms_percent": [size, size, 9.0], "e_rms_q05": 0.1, "e_rms_q95": 9.0}
        candidate.errors = PASSED.assign(**rms)
    text = f"Beyond kv_gm_1 it explains {said} of the range of the fitted records: a smooth error"
    assert (text in words.verdict(made)) == bool(said)
    assert ("Beyond" in words.verdict(made)) == bool(said)


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
    assert text.startswith("None of the 2 further experiments") and "may not survive" in text


def test_of_equal_experiments_one_in_range_is_proposed():
    far = entry("5 kV", 0.692, 1.0, extrapolation="voltage is higher")
    near = entry("3 kV", 0.690, 1.0)
    assert proposal(far, near).startswith("3 kV")
    assert proposal(far, near | {"information_candidate_nats": 0.6}).startswith("5 kV")


def test_a_held_out_record_is_to_be_fitted_and_not_proposed():
    have = (
        "To tell kv_gm_1 from kv_gm_2, the most telling record that is held out is sine. You have "
        "it: move it to `calibrate`. It would decide rightly with probability 0.99 (0.50 is "
        "guessing), but no longer test predictions."
    )
    held_out = entry("sine", 0.692, 0.99, held_out=True)
    assert proposal(held_out) == have
    text = proposal(held_out, entry("3 kV", 0.6, 0.93))
    assert text.startswith(f"{have} 3 kV (step 3 kV) would be expected")
    text = proposal(entry("sine", 0.019, 0.55, held_out=True), entry("3 kV", 0.6, 0.93))
    assert text.startswith("3 kV") and "sine" not in text


def test_an_uncertain_or_uninformative_experiment_is_not_promised():
    text = proposal(entry("sine", 0.2, 0.75))
    assert text == (
        "The only further experiment considered would not surely tell kv_gm_1 from kv_gm_2. The "
        "best is sine (step sine): it would decide rightly with probability 0.75 (0.50 is "
        "guessing)."
    )
    text = proposal(entry("sine", 0.019, 0.55))
    assert text == (
        "The only further experiment considered would not be expected to tell kv_gm_1 from kv_gm_2."
    )


def test_there_is_no_proposal_for_one_candidate_or_without_a_table():
    assert proposal(entry("3 kV", NAN, NAN) | {"candidates": "kv_gm_1"}) == ""
    assert words.further_sentence(SimpleNamespace(further_experiments=None)) == ""
