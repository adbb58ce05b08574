"""Tallying picks of model order."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from tests.validation.tally import outcome, single_picks, tally, unflagged_conflict

from deabayes.comparison import BlockLoo, Decision, Score, decide


def score(order, evidence, terms, converged=True):
    loo = BlockLoo(np.asarray(terms, float), np.zeros(len(terms))) if converged else None
    return Score(
        f"m_{order}", order, 2 * order, converged, evidence, 0.05, -evidence, float("nan"), loo
    )


def decision(chosen, *unresolved):
    return Decision(chosen, unresolved, {})


@pytest.mark.parametrize(
    ("made", "worth"),
    [
        (decision("m_2"), "right"),
        (decision("m_1"), "wrong"),
        (decision("m_2", "m_3"), "not resolved"),
        (decision("m_1", "m_2"), "not resolved"),
        (decision(None), "no verdict"),
    ],
)
def test_outcome(made, worth):
    assert outcome(made, "m_2") == worth


CLEAR = [score(1, 0.0, [0.0] * 20), score(2, 30.0, [2.0] * 20), score(3, 28.0, [1.95] * 20)]


def test_a_clear_pick_is_no_conflict():
    made = decide(CLEAR)
    assert made.chosen == "m_2" and not made.unresolved
    assert not unflagged_conflict(CLEAR, made)


@pytest.mark.parametrize("chosen", ["m_1", "m_3"])
def test_a_pick_against_the_criteria_is_a_conflict_unless_flagged(chosen):
    assert unflagged_conflict(CLEAR, decision(chosen))
    assert not unflagged_conflict(CLEAR, decision(chosen, "m_2"))


def test_a_pick_against_evidence_alone_is_a_conflict():
    scores = [score(1, 0.0, [0.0] * 20), score(2, 9.0, [0.01] * 20)]
    assert unflagged_conflict(scores, decision("m_1"))
    assert decide(scores).unresolved == ("m_2",)


def test_single_picks_pass_over_what_did_not_converge():
    scores = [*CLEAR[:2], score(3, 99.0, [9.0] * 20, converged=False)]
    assert set(single_picks(scores).values()) == {"m_2"}


def test_tally_counts_undecided_apart():
    outcomes = ["right", "right", "wrong", "not resolved", "no verdict"]
    replicates = pd.DataFrame(
        {
            "family": "m", "world": "closed", "truth": 2, "right": "m_2", "outcome": outcomes,
            "chosen": ["m_2", "m_2", "m_1", "m_2", None],
            "best_evidence": ["m_2", "m_2", "m_2", "m_2", None],
            "best_bic": ["m_1"] * 4 + [None], "best_elpd": ["m_3"] * 4 + [None],
            "unflagged_conflict": [0, 0, 1, 0, 0], "all_converged": [1, 1, 1, 1, 0],
        }
    )  # fmt: skip
    row = tally(replicates).iloc[0]
    assert (row["right"], row["wrong"], row["not resolved"], row["no verdict"]) == (2, 1, 1, 1)
    assert row["share right of all judged"] == "0.50"
    assert row["share right of those decided"] == "0.67"
    assert row["best evidence right"] == "1.00" and row["best bic right"] == "0.00"
    assert row["unflagged conflicts"] == 1 and row["picks"] == "m_1: 1, m_2: 3"
