"""The decision rule: what it chooses, when it declines to choose, and the words of its verdict."""

from dataclasses import replace

import numpy as np
import pytest

from deabayes.comparison.blocks import BlockLoo
from deabayes.comparison.decision import Score, decide, judge
from deabayes.comparison.verdicts import elpd_difference, ends_difference, odds, verdicts


def score(name, parameters, evidence, terms, converged=True, mcse=0.1):
    loo = BlockLoo(np.asarray(terms, float), np.zeros(len(terms))) if converged else None
    return Score(name, parameters, parameters, converged, evidence, mcse, 0.0, loo)


def named(scored):
    names = tuple(f"block {k}" for k in range(scored.loo.terms.size))
    return replace(scored, loo=replace(scored.loo, names=names))


def words(*scores):
    return verdicts(scores, decide(scores))


ONES = np.ones(20)
SPREAD = np.linspace(-1, 1, 20)


@pytest.mark.parametrize(
    ("evidence", "terms", "expected"),
    [
        (2.5, 1.5 * ONES, "larger"),
        (2.5, ONES, "conflict"),  # evidence that is not clear, alone
        (3.1, ONES, "larger"),  # clear evidence, to which blocks do not object
        (3.1, ONES - 0.1 - SPREAD, "larger"),  # a loss of 2 within an SE of 2.7
        (3.1, ONES - 0.2 - SPREAD, "conflict"),  # a loss of 4
        (30.0, 0.5 * ONES, "conflict"),
        (-9.0, 1.5 * ONES, "conflict"),  # blocks alone
        (0.5, 1.1 * ONES, "smaller"),  # +2 elpd and half a nat are not enough
        (2.5, ONES + 0.3 + 3 * SPREAD, "conflict"),  # gain of 6 within 2 SE
        (2.1, 1.5 * ONES, "larger"),
        (1.9, 1.5 * ONES, "conflict"),  # less than two nats of evidence
    ],
)
def test_a_larger_order_wins_by_clear_evidence_or_by_both_criteria(evidence, terms, expected):
    assert judge(score("b", 5, evidence, terms), score("a", 3, 0.0, ONES)) == expected


def test_an_evidence_within_two_errors_favours_neither():
    """Errors of 3 and 4 make one of 5 for the difference."""
    small = score("a", 3, 0.0, ONES, mcse=3.0)
    assert judge(score("b", 5, 9.9, 1.5 * ONES, mcse=4.0), small) == "conflict"
    assert judge(score("b", 5, 10.1, 1.5 * ONES, mcse=4.0), small) == "larger"


def test_the_elpd_difference_and_its_error_are_over_paired_blocks():
    terms = np.array([3.0, -5.0, 1.0])
    gains = np.array([1.0, 2.0, 6.0])
    large, small = score("b", 5, 0.0, terms + gains), score("a", 3, 0.0, terms)
    gain, error = elpd_difference(large, small)
    assert gain == 9.0
    assert error == pytest.approx(np.sqrt(3 * 7.0))  # (4 + 1 + 9) / 2
    assert small.loo.elpd == -1.0
    assert small.loo.se == pytest.approx(np.sqrt(3 * 52 / 3))  # of the mean -1/3


def test_one_block_with_most_of_the_gain_does_not_hide_the_gain_of_the_others():
    """The gains of a simulated specimen: two standard errors of their sum exceed any such sum."""
    gains = np.array([8.3, 16.7, 1.3, 70.9, 3.6, 5.2, 3.9, 7.1, 3.5])
    small = score("a", 3, 0.0, np.zeros(9))
    assert judge(score("b", 5, 112.0, gains), small) == "larger"
    assert judge(score("b", 5, 112.0, gains * np.where(gains > 20, 9.0, 1.0)), small) == "larger"
    assert judge(score("b", 5, -1.0, gains), small) == "conflict"


def test_a_large_gain_wins_although_blocks_differ():
    """Simulated specimens: 20.0 and 17.6 nats in all, 7.9 and 5.1 without the best block."""
    small = score("a", 3, 0.0, np.zeros(9))
    gains = np.array([12.1, 2.6, 1.3, -1.3, 0.7, 0.7, 2.0, -1.3, 3.1])
    assert judge(score("b", 5, 18.6, gains), small) == "larger"
    assert judge(score("b", 5, 0.0, gains), small) == "conflict"
    gains = [12.5, 0.4, -0.2, 1.1, -1.7, 1.4, 0.5, 0.4, 0.7, 0.7, 0.8, 0.1, 0.9]
    assert judge(score("b", 5, 13.5, gains), score("a", 3, 0.0, np.zeros(13))) == "larger"


def test_seven_nats_within_two_standard_errors_are_a_conflict():
    small = score("a", 3, 0.0, np.zeros(4))
    assert judge(score("b", 5, 2.5, [2.0, 2.0, 2.0, 1.0]), small) == "larger"
    assert judge(score("b", 5, 2.5, [7.5, 2.0, 2.0, -4.0]), small) == "conflict"


def test_no_block_decides_alone():
    """What is left without the best block must be 4 nats and a standard error."""
    small = score("a", 3, 0.0, np.zeros(9))
    gains = np.array([70.0, 0.6, 0.4, 0.5, 0.6, 0.4, 0.5, 0.4, 0.5])
    assert judge(score("b", 5, 2.5, gains), small) == "conflict"
    scattered = np.array([70.0, 9.0, -8.0, 9.0, -8.0, 9.0, -8.0, 9.0, -5.0])
    assert judge(score("b", 5, 2.5, scattered), small) == "conflict"
    assert judge(score("b", 5, 2.5, np.array([70.0])), score("a", 3, 0.0, [0.0])) == "conflict"


def test_ends_of_records_do_not_decide():
    """Treloar's rubber: the larger loses 34 nats at the end of the largest stretch only."""
    gained = np.array([3.2, 2.0, 1.1, 1.4, 1.9, 1.8, 1.4, 2.3, 1.8, 0.5, 0.2, 0.4, 1.1, 3.0, 2.3,
                       1.1, 0.9, 0.6, 1.8, 1.4, -34.0])  # fmt: skip
    ends = tuple(k in (0, 6, 7, 13, 14, 20) for k in range(21))
    small, large = score("gent", 5, 0.0, np.zeros(21)), score("ogden_3", 9, 2.9, gained)
    assert judge(large, small) == "conflict"
    small, large = (replace(named(s), loo=replace(named(s).loo, ends=ends)) for s in (small, large))
    assert judge(large, small) == "larger"
    assert elpd_difference(large, small)[0] == pytest.approx(18.0)
    assert ends_difference(large, small) == pytest.approx(-21.8)
    verdict = words(small, large)["gent"]
    assert verdict.endswith("; it extrapolates better to block 20 by 34 nats")


def test_too_few_interior_blocks_leave_all_to_decide():
    loo = BlockLoo(np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4), (), (True, False, False, True))
    assert loo.elpd == 10.0
    longer = BlockLoo(np.arange(5.0), np.zeros(5), (), (True, False, False, False, True))
    assert longer.elpd == 6.0 and longer.se == pytest.approx(np.sqrt(3.0))


LOST_END = np.array([9.0, 7.0, 10.0, 8.0, 11.0, 13.0, 9.0, 8.0, -51.0])


@pytest.mark.parametrize(
    ("evidence", "gained", "expected"),
    [
        (2.5, LOST_END, "block 8 (elpd -51.0): the others have +75.0 (SE 5.4)"),
        (2.5, [70.0, 0.4, 0.4, 0.4], "block 0 (elpd +70.0): the others have +1.2 (SE 0.0)"),
        (-3.0, [1.2, 5.0, 1.2, 1.2], "block 1 (elpd +5.0): the others have +3.6 (SE 0.0)"),
        (2.5, np.r_[LOST_END[:-2], -51.0, -51.0], ""),  # two are against it
        (2.5, ONES / 20, ""),  # none is
    ],
)
def test_a_verdict_names_the_one_block_that_makes_the_criteria_disagree(evidence, gained, expected):
    small = named(score("a", 3, 0.0, np.zeros(len(gained))))
    verdict = words(small, named(score("b", 5, evidence, gained)))["b"]
    assert verdict.startswith("not resolved by these data: elpd")
    assert ("one block decides, " in verdict) == bool(expected)
    assert verdict.endswith(expected)


def test_the_gain_of_the_decisive_block_is_that_of_the_candidate_of_the_row():
    """Here the larger one was chosen, and the smaller, ahead on one block only, contests it."""
    scores = [
        named(score("n1", 3, 0.0, ONES)),
        named(score("n2", 5, 2.5, ONES + 0.2 + 60.0 * (np.arange(20) == 4))),
        named(score("n3", 7, 5.0, ONES + 0.45)),
    ]
    decision = decide(scores)
    assert decision.chosen == "n3" and decision.unresolved == ("n2",)
    assert words(*scores)["n2"].endswith("block 4 (elpd +59.8): the others have -4.8 (SE 0.0)")


def test_a_resolved_order_names_no_block():
    scores = [named(score("a", 3, 0.0, ONES)), named(score("b", 5, 9.0, 1.5 * ONES))]
    assert not any("one block" in verdict for verdict in words(*scores).values())


def test_decision_walks_up_and_names_the_unresolved():
    scores = [
        score("n3", 7, 11.5, 1.6 * ONES),
        score("n1", 3, 0.0, ONES),
        score("n2", 5, 9.0, 1.5 * ONES),
        score("n4", 9, 40.0, 9 * ONES, converged=False),
    ]
    decision = decide(scores)
    assert (decision.chosen, decision.unresolved) == ("n2", ("n3",))
    assert words(*scores)["n2"].endswith("against n3; use n2 meanwhile, the smallest order")
    assert words(*scores)["n4"] == "not ranked: not converged"


def test_a_candidate_passed_over_may_still_contest_the_choice():
    """Orders 1 and 2 conflict, 3 beats 1 by both criteria, yet 2 beats 3 by both."""
    scores = [
        score("n1", 3, 0.0, ONES),
        score("n2", 5, 2.9, ONES + 3.9 / 20),
        score("n3", 7, 2.5, ONES + 4.2 / 20),
    ]
    decision = decide(scores)
    assert (decision.chosen, decision.unresolved) == ("n3", ("n2",))
    assert words(*scores)["n3"] == (
        "not resolved by these data against n2; use n3 meanwhile, though the fewer parameters of "
        "n2 may be enough"
    )


def test_equal_candidates_with_as_many_parameters_are_not_resolved():
    decision = decide([score("a", 3, 0.0, ONES), score("b", 3, 0.0, ONES)])
    assert decision.unresolved == ("b",)


def test_an_unknown_block_evidence_or_error_is_a_conflict():
    small = score("a", 3, 0.0, ONES)
    unknown = [
        score("b", 5, -9.0, np.where(np.arange(20) == 3, np.nan, ONES)),
        score("b", 5, np.nan, 1.5 * ONES),
        score("b", 5, 9.0, 1.5 * ONES, mcse=np.nan),
    ]
    assert [judge(large, small) for large in unknown] == ["conflict"] * 3


@pytest.mark.parametrize(("lost", "evidence", "terms"), [("n1", 0.0, ONES), ("n3", 30.0, 3 * ONES)])
def test_the_verdict_names_the_candidates_that_did_not_converge(lost, evidence, terms):
    """A larger one may be needed: specimen 10 of three membrane units that are shown."""
    scores = {"n1": score("n1", 3, 0.0, ONES), "n2": score("n2", 5, 9.0, 1.5 * ONES)}
    scores["n3"] = score("n3", 7, 8.0, 1.5 * ONES)
    scores[lost] = score(lost, scores[lost].n_parameters, evidence, terms, converged=False)
    assert words(*scores.values())["n2"].startswith(
        f"chosen: the smallest order the data cannot do without among those that converged; "
        f"{lost} did not"
    )


def test_the_verdict_says_how_sure_it_is():
    scores = [score("n1", 3, 0.0, ONES), score("n2", 5, 9.0, 1.5 * ONES)]
    assert words(*scores)["n2"].endswith(
        "; evidence for it over n1: very strong, odds over 1000 to 1"
    )
    scores.append(score("n3", 7, 7.0, 1.4 * ONES))
    assert words(*scores)["n2"].endswith("the larger n3: positive, odds 7.4 to 1")
    assert odds(-3.5) == "strong, odds 33 to 1"
    assert odds(0.0) == "weak, odds 1.0 to 1"


def test_the_verdict_names_a_candidate_that_predicts_left_out_records_better():
    """Treloar's rubber: Gent predicts two of three deformations better from the other two."""
    small, large = score("gent", 5, 0.0, ONES), score("ogden_3", 9, 9.0, 1.5 * ONES)
    for gain, better in ((30.0, True), (3.9, False), (-30.0, False)):
        first = replace(small, leave_one_experiment_out=-100.0 + gain)
        second = replace(large, leave_one_experiment_out=-100.0)
        assert ("but gent predicts records" in words(first, second)["ogden_3"]) == better


def test_a_verdict_shows_by_how_much_the_others_fall_short():
    scores = [score("n1", 3, 0.0, ONES), score("n2", 5, 9.0, 1.5 * ONES)]
    scores.append(score("n3", 7, 7.0, 1.4 * ONES))
    verdict = words(*scores)
    assert verdict["n1"] == "not chosen: elpd -10.0 (SE 0.0), log evidence -9.0 against n2"
    assert verdict["n3"] == "not chosen: elpd -2.0 (SE 0.0), log evidence -2.0 against n2"


def test_a_single_candidate_is_chosen_only_if_no_other_was_asked_for():
    one, lost = score("a", 3, 0.0, ONES), score("b", 5, 9.0, ONES, converged=False)
    assert words(one)["a"] == "chosen: the only candidate that was compared"
    assert decide([one, lost]).chosen is None
    assert words(one, lost)["a"].startswith("nothing to compare")
    assert decide([lost]).chosen is None


def nested(score, evidence, error=0.1):
    return replace(score, log_evidence_nested=evidence, log_evidence_nested_error=error)


@pytest.mark.parametrize(
    ("mcse", "evidence", "error", "said"),
    [  # errors of 0.6 and 0.8 make one of 1.0
        (0.6, 1.6, 0.8, "-1.6 (standard error 1.0)"),
        (0.6, -1.6, 0.8, "+1.6 (standard error 1.0)"),
        (0.6, 1.4, 0.8, ""),
        (0.6, -1.4, 0.8, ""),
        (np.nan, 50.0, 0.1, "-50.0 (standard error 0.1)"),
        (0.1, np.nan, np.nan, ""),  # not checked
    ],
)
def test_two_evidences_may_differ_by_half_a_nat_and_their_errors(mcse, evidence, error, said):
    checked = nested(score("a", 3, 0.0, ONES, mcse=mcse), evidence, error)
    verdict = words(checked)["a"]
    assert checked.evidence_conflict == bool(said)
    assert (f"; bridge and nested sampling differ by {said} in" in verdict) == bool(said)
    assert verdict.endswith("rely on neither") == bool(said)


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
