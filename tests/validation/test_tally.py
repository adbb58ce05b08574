"""Tallying picks of model order."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.comparison.blocks import BlockLoo
from deabayes.comparison.decision import Decision, Score, decide
from tests.validation.tally import (
    outcome,
    scores_of,
    single_picks,
    tally,
    verdict,
)


def score(order, evidence, terms, converged=True):
    loo = BlockLoo(np.asarray(terms, float), np.zeros(len(terms))) if converged else None
    return Score(f"m_{order}", order, 2 * order, converged, evidence, 0.05, -evidence, loo)


def decision(chosen, *unresolved):
    return Decision(chosen, unresolved)


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


def test_single_picks_pass_over_what_did_not_converge():
    scores = [*CLEAR[:2], score(3, 99.0, [9.0] * 20, converged=False)]
    assert set(single_picks(scores).values()) == {"m_2"}


def stored(truth, *scores, signal="99.00", noise=(0.0, 0.05, 0.0, 0.0)):
    """A row as `order_selection` stores it; `noise` is correlated noise by order."""
    row = {"family": "m", "world": "closed", "truth": str(truth), "signal": signal, "ends": ""}
    for each in scores:
        row |= {
            f"parameters:{each.order}": str(each.n_parameters),
            f"log_evidence:{each.order}": f"{each.log_evidence}",
            f"mcse:{each.order}": f"{each.log_evidence_mcse}",
            f"bic:{each.order}": f"{each.bic}",
            f"correlated:{each.order}": f"{noise[each.order]}",
            f"white:{each.order}": "0.003",
            f"terms:{each.order}": " ".join(map(str, each.loo.terms)) if each.loo else "",
        }
    return row


CONFLICT = [score(1, 0.0, [0.0] * 20), score(2, 2.5, [0.01] * 20), score(3, -9.0, [-1.0] * 20)]
ALONE = [
    score(1, 0.0, [], converged=False),
    score(2, 0.0, [0.0] * 20),
    score(3, 0.0, [], converged=False),
]


def test_a_row_holds_all_that_the_rule_goes_by():
    mixed = [*CLEAR[:2], score(3, 99.0, [9.0] * 20, converged=False)]
    for scores in (CLEAR, CONFLICT, mixed):
        again = scores_of(stored(2, *scores))
        assert decide(again) == decide(scores)
        assert single_picks(again) == single_picks(scores)


@pytest.mark.parametrize(("truth", "right"), [(1, "m_1"), (3, "m_3"), (4, "m_3")])
def test_right_is_the_true_order_or_the_largest_there_is(truth, right):
    found = verdict(stored(truth, *CLEAR))
    assert found["right"] == right
    assert found["outcome"] == "wrong" and found["chosen"] == "m_2"


def test_tally_counts_where_the_last_unit_is_shown():
    rows = [stored(2, *CLEAR), stored(2, *CLEAR), stored(2, *CONFLICT), stored(2, *ALONE)]
    rows += [stored(2, *CLEAR[:1], signal="16.90"), stored(1, *CLEAR, signal="inf")]
    first, row = tally(rows)
    assert (first["true units"], first["wrong"], first["surplus unit"]) == ("1", 1, 1)
    assert (row["specimens"], row["last unit is shown"], row["surplus unit"]) == (5, 4, 0)
    assert (row["right"], row["wrong"], row["not resolved"], row["no verdict"]) == (2, 0, 1, 1)
    assert (row["share right"], first["share right"]) == ("0.67", "0.00")
    for criterion in ("evidence", "bic", "elpd"):
        assert row[f"right by {criterion} alone"] == "1.00"


@pytest.mark.parametrize(
    ("noise", "cautioned"), [((0, 0.011, 0.004, 0), False), ((0, 0.010, 0.004, 0), True)]
)
def test_a_unit_that_explains_little_is_cautioned(noise, cautioned):
    rows = [stored(truth, *CLEAR, noise=noise) for truth in (2, 3)]
    right, wrong = tally(rows)
    assert (right["right"], right["right with caution"]) == (1, cautioned)
    assert (wrong["wrong"], wrong["wrong without caution"]) == (1, not cautioned)
    assert not verdict(stored(1, score(1, 50.0, [3.0] * 20), *CLEAR[1:], noise=noise))["cautioned"]
