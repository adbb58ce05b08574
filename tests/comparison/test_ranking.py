"""Blocks that all candidates share, and the rows of comparison.csv, with posteriors made up."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from deabayes.comparison import ranking
from deabayes.comparison.blocks import BlockLoo
from deabayes.comparison.ranking import Ranked, common_blocks, comparison_table
from deabayes.inference.blocks import block_names

TIME = np.arange(200.0)


def record(name="a", factor=1.0):
    experiment = SimpleNamespace(
        name=name, response_range=4.0, coordinate=factor * TIME, coordinate_name="time",
        coordinate_unit="s",
    )  # fmt: skip
    return SimpleNamespace(group="step", noise_coordinate=factor * TIME, experiment=experiment)


def ranked(candidate, length=None, records=None, converged=True, responses=None, **scores):
    """A candidate with draws skewed about their median `length` of its correlation time."""
    noise = SimpleNamespace(length="" if length is None else "tau_ou")
    names = ["E_0"] if length is None else ["E_0", "step.tau_ou"]
    skewed = np.r_[np.linspace(0.9, 1.1, 60), np.full(40, 20.0)]
    skewed *= (length or 1.0) / np.median(skewed)
    values = {"E_0": np.ones((2, 50)), "step.tau_ou": skewed.reshape(2, 50)}
    posterior = xr.Dataset({name: (("chain", "draw"), values[name]) for name in names})
    unconstrained = xr.Dataset({"z": (("chain", "draw", "parameter"), np.zeros((2, 50, 1)))})
    tree = xr.DataTree.from_dict({"posterior": posterior, "unconstrained_posterior": unconstrained})
    tree.attrs.update(
        candidate=candidate, order=int(candidate[-1]),
        convergence=json.dumps({"converged": converged}),
    )  # fmt: skip
    target = SimpleNamespace(
        names=tuple(names), noise=noise, records=records or [record()],
        dimension=2 * int(candidate[-1]) + 1, responses=lambda theta: responses,
    )  # fmt: skip
    given = {"log_evidence": 0.0, "log_evidence_mcse": 0.1, "bic": -1.0}
    return Ranked(tree, target, given | scores)


def block_loo_of(elpd):
    return BlockLoo(np.full(10, elpd / 10), np.array([0.1] * 9 + [0.6]))


def starts(*candidates):
    return common_blocks(candidates)["a"].tolist()


def test_blocks_are_two_of_the_longest_correlation_times_long():
    assert starts(ranked("k_1", 5.0), ranked("k_2", 2.0))[:3] == [0, 10, 20]
    assert starts(ranked("k_1", 2.0), ranked("k_2", 5.0)) == starts(ranked("k_1", 5.0))


def test_a_long_correlation_leaves_ten_blocks_and_none_three_points():
    assert starts(ranked("k_1", 500.0)) == list(range(0, 200, 20))
    assert starts(ranked("k_1"))[:4] == [0, 3, 6, 9]


def test_points_with_equal_coordinates_do_not_shorten_the_blocks():
    turned = record()
    turned.noise_coordinate = turned.experiment.coordinate = np.repeat(np.arange(100.0), 2)
    assert starts(ranked("k_1", records=[turned]))[:3] == [0, 6, 12]


def test_only_a_block_with_unreliable_weights_is_sampled_without(monkeypatch):
    """Weights of the third block are a Pareto law's of shape 0.65, of the fourth 1.5."""
    rng = np.random.default_rng(1)
    pointwise = {name: 0.05 * rng.normal(size=(4000, 20)) for name in "ab"}
    quantiles = -np.log((np.arange(4000.0)[:, None] + 0.5) / 4000)
    pointwise["b"][:, :10] -= 0.065 * quantiles
    pointwise["b"][:, 10:] -= 0.15 * quantiles
    one = ranked("k_1", records=[record("a"), record("b", 2.0)])
    for each in one.target.records:
        each.experiment.coordinate = each.experiment.coordinate[:20]
    one.target.pointwise_log_likelihood = lambda theta: {
        name: values[theta[:, 0].astype(int)] for name, values in pointwise.items()
    }
    one.target.prior = SimpleNamespace(to_normal=lambda theta: theta)
    draws = xr.Dataset({"E_0": (("chain", "draw"), np.arange(4000.0).reshape(2, 2000))})
    one.tree["posterior"] = xr.DataTree(draws)
    asked = []

    def leave_blocks_out(target, problem, blocks, *given):
        asked.append((target, problem, blocks))
        return np.full(len(blocks), -77.0)

    monkeypatch.setattr(ranking, "leave_blocks_out", leave_blocks_out)
    monkeypatch.setattr(ranking, "problem_of", lambda target: ("problem of", target))
    edges = {name: np.array([0, 10]) for name in "ab"}
    loo = ranking._sampled(one, ranking.block_loo(one, edges), edges, np.random.SeedSequence(1))
    blocks = [("b", slice(0, 10)), ("b", slice(10, 20))]
    assert asked == [(one.target, ("problem of", one.target), blocks)]
    assert loo.terms.tolist()[2:] == [-77.0, -77.0]
    assert 0.5 < loo.k_hat[2] < 0.7 < loo.k_hat[3]
    np.testing.assert_allclose(loo.terms[:2], 0.0, atol=0.2)
    assert loo.names[2:] == ("the beginning of b, time 0 to 18 s", "the end of b, time 20 to 38 s")


@pytest.mark.parametrize(
    ("elpd", "evidence", "sampled"),
    [
        ({"a": 0.0, "b": 40.0, "c": 80.0}, {"a": 0.0, "b": 40.0, "c": 80.0}, ["b", "c"]),
        ({"a": 0.0, "b": 80.0}, {"a": 0.0, "b": 20.0}, ["a", "b"]),  # evidence is close
        ({"a": 20.0, "b": 40.0}, {"a": 0.0, "b": 80.0}, ["a", "b"]),  # elpd is close
        ({"a": 0.0, "b": 80.0}, {"a": 0.0, "b": 80.0}, []),  # b alone: nothing to tell it from
        ({"a": 0.0, "b": 80.0}, {"a": np.nan, "b": 80.0}, ["a", "b"]),  # not known
        ({}, {}, []),
    ],
)
def test_a_candidate_far_behind_is_not_sampled(elpd, evidence, sampled):
    scores = [
        ranking._score(ranked(f"{name}_1", log_evidence=evidence[name]), block_loo_of(value))
        for name, value in elpd.items()
    ]
    assert [name[0] for name in ranking.close_calls(scores)] == sampled


def test_the_largest_difference_of_curves_over_a_stretch_has_no_unit() -> None:
    """Of a curve over a stretch no "1.39 1" is said."""
    curve = SimpleNamespace(
        name="pull", response_range=1.0, coordinate=np.linspace(1, 3, 21),
        coordinate_name="stretch", coordinate_unit="1",
    )  # fmt: skip
    flat = np.zeros((3, 21))
    bent = flat + 0.1 * (np.arange(21) == 4)
    one, two = (
        ranked(name, records=[SimpleNamespace(experiment=curve)], responses={"pull": values})
        for name, values in (("k_1", flat), ("k_2", bent))
    )
    said = ranking._difference(two, [one, two], SimpleNamespace(chosen="k_1"))
    assert said.endswith("at most 10 % of the range, in pull at stretch 1.4")


def test_a_block_is_named_by_record_and_place():
    strip = SimpleNamespace(
        coordinate=np.linspace(1, 3, 21), coordinate_name="stretch", coordinate_unit="1"
    )
    places = [("pull", slice(0, 5)), ("pull", slice(5, 18)), ("pull", slice(18, 21))]
    assert block_names({"pull": strip}, places) == (
        "the beginning of pull, stretch 1 to 1.4",
        "pull, stretch 1.5 to 2.7",
        "the end of pull, stretch 2.8 to 3",
    )


SCORES = {
    "k_1": {"log_evidence": -70.0, "bic": 30.0},
    "k_2": {"log_evidence": -8.0, "bic": 20.0, "log_evidence_nested": -8.2,
            "log_evidence_nested_error": 0.1},
    "k_3": {"log_evidence": -9.0, "bic": 21.0, "log_evidence_nested": -3.0,
            "log_evidence_nested_error": 0.1},
}  # fmt: skip
TERMS = {"k_1": -6.0, "k_2": 1.0, "k_3": 1.6}


@pytest.fixture
def table(monkeypatch):
    """Of four candidates: the third gains 6 nats of elpd over the second and loses evidence."""

    def loo(candidate, edges):
        assert list(edges) == ["a", "b"]
        return block_loo_of(10 * TERMS[candidate.candidate])

    def gains(target, log_evidence, z, seed):
        assert z.shape == (100, 1)
        return {"a": log_evidence / 2, "b": log_evidence / 2 + 1.0}

    monkeypatch.setattr(ranking, "block_loo", loo)
    monkeypatch.setattr(ranking, "_sampled", lambda candidate, loo, edges, seed: loo)
    monkeypatch.setattr(ranking, "leave_one_experiment_out", gains)
    records = [record(), record("b", 2.0)]
    flat = np.zeros((3, 200))
    apart = flat.copy()
    apart[:, 70] = [0.0, -0.4, 9.0]
    more = np.full((3, 200), 0.3)
    more[:, 50] = -0.4
    answers = {"k_1": None, "k_2": {"a": flat, "b": flat}, "k_3": {"a": more, "b": apart}}
    candidates = [
        ranked(name, 5.0, records, responses=answers[name], **scores)
        for name, scores in SCORES.items()
    ]
    candidates.append(ranked("k_4", 5.0, records, converged=False, log_evidence=99.0))
    return comparison_table(candidates, np.random.SeedSequence(1)).set_index("candidate")


def test_a_row_holds_its_own_scores(table):
    two = table.loc["k_2"]
    assert (two["order"], two["n_parameters"], two["bic"]) == (2, 5, 20.0)
    assert (two["log_evidence"], two["log_evidence_mcse"]) == (-8.0, 0.1)
    assert (two["log_evidence_nested"], two["log_evidence_nested_error"]) == (-8.2, 0.1)
    assert (two["elpd_block_loo"], two["elpd_block_loo_se"]) == (10.0, 0.0)
    assert two["elpd_leave_one_experiment_out"] == -7.0
    assert two["worst_k_hat"] == 0.6


def test_experiments_are_left_out_only_where_a_candidate_is_not_far_behind(table):
    left_out = table["elpd_leave_one_experiment_out"]
    assert left_out.tolist() == pytest.approx([np.nan, -7.0, -8.0, np.nan], nan_ok=True)


def test_differences_are_to_the_chosen_one(table):
    assert table["elpd_difference"].tolist()[:3] == pytest.approx([-70.0, 0.0, 6.0])
    assert table["verdict"].str.contains("not resolved").tolist() == [False, True, True, False]


def test_a_candidate_that_did_not_converge_has_no_elpd(table):
    lost = table.loc["k_4"]
    assert not lost["converged"] and lost["verdict"] == "not ranked: not converged"
    assert (
        lost[["elpd_block_loo", "elpd_block_loo_se", "elpd_difference", "worst_k_hat"]].isna().all()
    )


def test_a_verdict_says_that_the_two_evidences_disagree(table):
    assert table["verdict"].str.contains("rely on neither").tolist() == [False, False, True, False]


def test_an_unresolved_candidate_says_where_its_median_curve_differs_most(table):
    """By 0.4 of 4 once in a; in b the median of 0, -0.4 and 9 is 0."""
    assert table["differs_in"].tolist()[:2] == ["", ""]
    assert table.loc["k_3", "differs_in"] == (
        "median curves differ from k_2 by at most 10 % of the range, in a at time 50 s"
    )
