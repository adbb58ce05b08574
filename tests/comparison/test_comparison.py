"""The decision rule: what it picks, and when it declines to pick."""

import dataclasses

import numpy as np
import pytest

from deabayes.comparison.decision import (
    Score,
    decide,
    elpd_difference,
    evidence_conflict,
    judge,
)
from deabayes.comparison.left_out import BlockLoo, block_edges, block_terms


def score(name, parameters, evidence, terms, converged=True, mcse=0.1):
    loo = BlockLoo(np.asarray(terms, float), np.zeros(len(terms))) if converged else None
    return Score(name, parameters, parameters, converged, evidence, mcse, 0.0, np.nan, loo)


ONES = np.ones(20)
SPREAD = np.linspace(-1, 1, 20)


def test_larger_order_needs_both_criteria():
    small, large = score("a", 3, 0.0, ONES), score("b", 5, 9.0, 1.5 * ONES)
    assert judge(large, small) == "larger"


@pytest.mark.parametrize(
    ("evidence", "terms", "expected"),
    [
        (9.0, ONES, "conflict"),  # evidence alone
        (-9.0, 1.5 * ONES, "conflict"),  # elpd alone
        (0.5, 1.1 * ONES, "smaller"),  # +2 elpd and half a nat are not enough
        (9.0, ONES + 0.3 + 3 * SPREAD, "conflict"),  # gain of 6 within 2 SE
        (1.5, 1.5 * ONES, "larger"),
        (0.9, 1.5 * ONES, "conflict"),  # less than a nat of evidence
    ],
)
def test_anything_less_keeps_the_smaller_or_says_so(evidence, terms, expected):
    assert judge(score("b", 5, evidence, terms), score("a", 3, 0.0, ONES)) == expected


def test_an_evidence_within_two_errors_does_not_speak():
    """Errors of 3 and 4 make one of 5 for the difference."""
    small = score("a", 3, 0.0, ONES, mcse=3.0)
    assert judge(score("b", 5, 9.9, 1.5 * ONES, mcse=4.0), small) == "conflict"
    assert judge(score("b", 5, 10.1, 1.5 * ONES, mcse=4.0), small) == "larger"


def test_the_difference_counts_from_the_smaller_and_pairs_the_blocks():
    terms = np.array([3.0, -5.0, 1.0])
    gains = np.array([1.0, 2.0, 6.0])
    large, small = score("b", 5, 0.0, terms + gains), score("a", 3, 0.0, terms)
    gain, error = elpd_difference(large, small)
    assert gain == 9.0
    assert error == pytest.approx(np.sqrt(3 * 7.0))  # (4 + 1 + 9) / 2
    assert small.loo.elpd == -1.0
    assert small.loo.se == pytest.approx(np.sqrt(3 * 52 / 3))  # of the mean -1/3


def test_one_block_with_most_of_the_gain_does_not_hide_what_the_others_gain():
    """The gains of a simulated specimen: two standard errors of their sum exceed any such sum."""
    gains = np.array([8.3, 16.7, 1.3, 70.9, 3.6, 5.2, 3.9, 7.1, 3.5])
    small = score("a", 3, 0.0, np.zeros(9))
    assert judge(score("b", 5, 112.0, gains), small) == "larger"
    assert judge(score("b", 5, 112.0, gains * np.where(gains > 20, 9.0, 1.0)), small) == "larger"
    assert judge(score("b", 5, -1.0, gains), small) == "conflict"


def test_blocks_need_not_be_alike():
    """Simulated specimens: 20.0 and 17.6 nats in all, 7.9 and 5.1 without the best block."""
    small = score("a", 3, 0.0, np.zeros(9))
    gains = np.array([12.1, 2.6, 1.3, -1.3, 0.7, 0.7, 2.0, -1.3, 3.1])
    assert judge(score("b", 5, 18.6, gains), small) == "larger"
    assert judge(score("b", 5, 0.0, gains), small) == "conflict"
    gains = [12.5, 0.4, -0.2, 1.1, -1.7, 1.4, 0.5, 0.4, 0.7, 0.7, 0.8, 0.1, 0.9]
    assert judge(score("b", 5, 13.5, gains), score("a", 3, 0.0, np.zeros(13))) == "larger"


def test_seven_nats_within_two_standard_errors_are_not_enough():
    small = score("a", 3, 0.0, np.zeros(4))
    assert judge(score("b", 5, 9.0, [2.0, 2.0, 2.0, 1.0]), small) == "larger"
    assert judge(score("b", 5, 9.0, [7.5, 2.0, 2.0, -4.0]), small) == "conflict"


def test_no_block_decides_alone():
    """What is left without the best block must be 4 nats and a standard error."""
    small = score("a", 3, 0.0, np.zeros(9))
    gains = np.array([70.0, 0.6, 0.4, 0.5, 0.6, 0.4, 0.5, 0.4, 0.5])
    assert judge(score("b", 5, 70.0, gains), small) == "conflict"
    scattered = np.array([70.0, 9.0, -8.0, 9.0, -8.0, 9.0, -8.0, 9.0, -5.0])
    assert judge(score("b", 5, 70.0, scattered), small) == "conflict"
    assert judge(score("b", 5, 70.0, np.array([70.0])), score("a", 3, 0.0, [0.0])) == "conflict"


def named(name, parameters, evidence, terms):
    scored = score(name, parameters, evidence, terms)
    names = tuple(f"block {k}" for k in range(len(terms)))
    return dataclasses.replace(scored, loo=dataclasses.replace(scored.loo, names=names))


LOST_END = np.array([9.0, 7.0, 10.0, 8.0, 11.0, 13.0, 9.0, 8.0, -51.0])


@pytest.mark.parametrize(
    ("evidence", "gained", "expected"),
    [
        (56.0, LOST_END, "block 8 (elpd -51.0): the others have +75.0 (SE 5.4)"),
        (70.0, [70.0, 0.4, 0.4, 0.4], "block 0 (elpd +70.0): the others have +1.2 (SE 0.0)"),
        (-3.0, [1.2, 5.0, 1.2, 1.2], "block 1 (elpd +5.0): the others have +3.6 (SE 0.0)"),
        (56.0, np.r_[LOST_END[:-2], -51.0, -51.0], ""),  # two are against it
        (9.0, ONES / 20, ""),  # none is
    ],
)
def test_the_one_block_that_keeps_the_criteria_apart_is_named(evidence, gained, expected):
    small = named("a", 3, 0.0, np.zeros(len(gained)))
    verdict = decide([small, named("b", 5, evidence, gained)]).verdicts["b"]
    assert verdict.startswith("not resolved by these data: elpd")
    assert ("one block decides, " in verdict) == bool(expected)
    assert verdict.endswith(expected)


def test_the_block_counts_for_the_candidate_of_the_row():
    """Here the larger one was chosen, and the smaller, ahead on one block only, contests it."""
    scores = [
        named("n1", 3, 0.0, ONES),
        named("n2", 5, 9.0, ONES + 0.2 + 60.0 * (np.arange(20) == 4)),
        named("n3", 7, 14.0, ONES + 0.45),
    ]
    decision = decide(scores)
    assert decision.chosen == "n3" and decision.unresolved == ("n2",)
    assert decision.verdicts["n2"].endswith("block 4 (elpd +59.8): the others have -4.8 (SE 0.0)")


def test_a_resolved_order_names_no_block():
    scores = [named("a", 3, 0.0, ONES), named("b", 5, 9.0, 1.5 * ONES)]
    assert not any("one block" in verdict for verdict in decide(scores).verdicts.values())


def test_decision_walks_up_and_names_the_unresolved():
    scores = [
        score("n3", 7, 12.0, 1.6 * ONES),
        score("n1", 3, 0.0, ONES),
        score("n2", 5, 9.0, 1.5 * ONES),
        score("n4", 9, 40.0, 9 * ONES, converged=False),
    ]
    decision = decide(scores)
    assert decision.chosen == "n2"
    assert decision.unresolved == ("n3",)
    assert decision.verdicts["n2"].endswith("against n3; the smallest order")
    assert decision.verdicts["n4"] == "not ranked: not converged"


def test_a_candidate_passed_over_may_still_contest_the_choice():
    """Orders 1 and 2 conflict, 3 beats 1 by both criteria, yet 2 beats 3 by both."""
    scores = [
        score("n1", 3, 0.0, ONES),
        score("n2", 5, 9.0, ONES + 3.9 / 20),
        score("n3", 7, 4.0, ONES + 4.2 / 20),
    ]
    decision = decide(scores)
    assert decision.chosen == "n3"
    assert decision.unresolved == ("n2",)
    assert decision.verdicts["n3"] == (
        "not resolved by these data against n2; shown, though n2 has fewer parameters and may do"
    )


def test_candidates_of_one_size_that_say_the_same_are_not_told_apart():
    decision = decide([score("a", 3, 0.0, ONES), score("b", 3, 0.0, ONES)])
    assert decision.unresolved == ("b",)


def test_an_unknown_block_decides_nothing():
    unknown = score("b", 5, -9.0, np.where(np.arange(20) == 3, np.nan, ONES))
    assert judge(unknown, score("a", 3, 0.0, ONES)) == "conflict"


def test_an_unknown_evidence_decides_nothing():
    small = score("a", 3, 0.0, ONES)
    for evidence, error in ((np.nan, 0.1), (9.0, np.nan)):
        large = dataclasses.replace(score("b", 5, evidence, 1.5 * ONES), log_evidence_mcse=error)
        assert judge(large, small) == "conflict"


def test_the_verdict_says_what_was_compared():
    alone = decide([score("a", 3, 0.0, ONES)])
    assert alone.verdicts["a"] == "chosen: the only candidate that was compared"
    scores = [
        score("n1", 3, 0.0, ONES, converged=False),
        score("n2", 5, 9.0, 1.5 * ONES),
        score("n3", 7, 8.0, 1.5 * ONES),
    ]
    words = decide(scores).verdicts["n2"]
    assert words.startswith("chosen: the smallest order the data cannot do without among")
    assert words.endswith("n1 did not")


def test_the_verdict_says_that_a_larger_order_did_not_converge():
    """It may be the one that is needed: specimen 10 of three membrane units that are shown."""
    scores = [
        score("n1", 3, 0.0, ONES),
        score("n2", 5, 9.0, 1.5 * ONES),
        score("n3", 7, 30.0, 3.0 * ONES, converged=False),
    ]
    assert decide(scores).verdicts["n2"].endswith("among those that converged; n3 did not")


def test_a_verdict_shows_by_how_much_the_others_fall_short():
    scores = [score("n1", 3, 0.0, ONES), score("n2", 5, 9.0, 1.5 * ONES)]
    scores.append(score("n3", 7, 7.0, 1.4 * ONES))
    verdicts = decide(scores).verdicts
    assert verdicts["n1"] == "not chosen: elpd -10.0 (SE 0.0), log evidence -9.0 against n2"
    assert verdicts["n3"] == "not chosen: elpd -2.0 (SE 0.0), log evidence -2.0 against n2"


def test_one_that_converged_among_others_is_not_chosen():
    lost = score("b", 5, 9.0, ONES, converged=False)
    decision = decide([score("a", 3, 0.0, ONES), lost])
    assert decision.chosen is None
    assert decision.verdicts["a"].startswith("nothing to compare")


@pytest.mark.parametrize(("nested", "said"), [(1.6, "-1.6"), (-1.6, "+1.6"), (1.4, ""), (-1.4, "")])
def test_two_evidences_may_differ_by_half_a_nat_and_their_errors(nested, said):
    """Errors of 0.6 and 0.8 make one of 1.0."""
    checked = dataclasses.replace(
        score("a", 3, 0.0, ONES, mcse=0.6),
        log_evidence_nested=nested,
        log_evidence_nested_error=0.8,
    )
    words = evidence_conflict(checked)
    assert words.startswith(f"bridge and nested sampling differ by {said} ") if said else not words


def test_evidence_checked_without_a_known_error_may_still_conflict():
    checked = dataclasses.replace(
        score("a", 3, 0.0, ONES), log_evidence_mcse=np.nan, log_evidence_nested=50.0,
        log_evidence_nested_error=0.1,
    )  # fmt: skip
    assert "rely on neither" in evidence_conflict(checked)


def nested(score, evidence):
    return dataclasses.replace(score, log_evidence_nested=evidence, log_evidence_nested_error=0.1)


@pytest.mark.parametrize(
    ("bridge", "by_nested", "expected"),
    [
        (9.0, 8.0, "larger"),  # they differ, and say the same
        (9.0, -3.0, "conflict"),
        (-3.0, 9.0, "conflict"),
        (9.0, np.nan, "larger"),  # not checked
    ],
)
def test_two_evidences_that_answer_differently_decide_nothing(bridge, by_nested, expected):
    small = nested(score("a", 3, 0.0, ONES), 0.0)
    assert judge(nested(score("b", 5, bridge, 1.5 * ONES), by_nested), small) == expected


def test_nothing_is_chosen_when_nothing_converged():
    decision = decide([score("a", 3, 0.0, ONES, converged=False)])
    assert decision.chosen is None


def test_blocks_are_long_enough_and_cover_every_point():
    coordinate = np.concatenate([np.linspace(0, 1, 50), np.linspace(1.1, 100, 40)])
    edges = block_edges(coordinate, 10.0)
    starts = coordinate[edges]
    assert edges[0] == 0 and np.all(np.diff(starts) >= 10.0)
    pointwise = np.random.default_rng(1).normal(size=(3, coordinate.size))
    terms = block_terms(pointwise, edges)
    np.testing.assert_allclose(terms.sum(1), pointwise.sum(1))


def test_a_rest_shorter_than_half_a_block_belongs_to_the_last():
    assert block_edges(np.arange(25.0), 10.0).tolist() == [0, 10]
    assert block_edges(np.arange(26.0), 10.0).tolist() == [0, 10, 20]
    assert block_edges(np.arange(12.0), 10.0).tolist() == [0, 10]
