"""A replicate of the order selection, from simulated records to a row, with draws made up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from deabayes.comparison.decision import Score, decide
from deabayes.comparison.ranking import score_all
from tests.validation import order_selection
from tests.validation.order_signal import SHOWN, divergence, signal, true_curves
from tests.validation.sampled import Sampled
from tests.validation.tally import verdict
from tests.validation.tubular_worlds import tubular

TASK = {"family": "voigt_kelvin", "world": "closed", "truth": 1, "replicate": 0}


def sample_near_the_best(target, seed):
    """Draws near the best of a few hundred draws of the prior, instead of sampling."""
    rng = np.random.default_rng(seed)
    tried = rng.standard_normal((400, target.dimension))
    best = tried[np.argmax(target(tried))]
    chain = best + 0.02 * rng.standard_normal((2, 50, 4, target.dimension))
    convergence = SimpleNamespace(converged=True, table=pd.DataFrame({"ess_bulk": [200.0]}))
    return Sampled(target, SimpleNamespace(chain=chain, convergence=convergence), 1.0)


def test_a_replicate_is_decided_by_the_shipped_rule(monkeypatch):
    monkeypatch.setattr(order_selection, "sample", sample_near_the_best)
    decided = []
    monkeypatch.setattr(
        order_selection, "score_all", lambda *a: decided.append(score_all(*a)) or decided[0]
    )
    row = order_selection.replicate(TASK)
    found = verdict({**TASK, **row})
    assert found["right"] == "voigt_kelvin_1"
    assert found["chosen"] == decide(decided[0]).chosen
    blocks = {len(row[f"terms:{order}"].split()) for order in order_selection.CANDIDATES}
    assert len(blocks) == 1 and blocks.pop() > 5
    for order, score in zip(order_selection.CANDIDATES, decided[0], strict=True):
        assert float(row[f"log_evidence:{order}"]) == pytest.approx(score.log_evidence, abs=1e-3)
        terms = np.array(row[f"terms:{order}"].split(), float)
        np.testing.assert_allclose(terms, score.loo.terms, atol=1e-3)
        extent = float(row["noise_share"])
        assert 0.2 * extent < float(row[f"correlated:{order}"]) + float(row[f"white:{order}"]) < 1


def test_a_candidate_that_did_not_converge_has_a_row_without_blocks():
    row = order_selection._score(Score("m_2", 2, 5, False, -3.0, 0.1, 7.0, None))
    assert (row["terms:2"], row["k_hat:2"], row["log_evidence:2"]) == ("", "", "-3.000")


@pytest.mark.parametrize("truth", [1, 3])
def test_the_same_replicate_has_the_same_data(monkeypatch, truth):
    seen = []

    def sample(target, seed):
        seen.append(target.records[0].experiment.response)
        raise InterruptedError

    monkeypatch.setattr(order_selection, "sample", sample)
    for _ in range(2):
        with pytest.raises(InterruptedError):
            order_selection.replicate({**TASK, "truth": truth})
    np.testing.assert_array_equal(*seen)


def test_the_world_shown_has_only_specimens_that_show_their_last_unit():
    world, rng = tubular(), np.random.default_rng(1)
    truth = world.target(2)
    seen = {
        name: [order_selection._simulated(world, truth, name, rng)[1] for _ in range(count)]
        for name, count in (("closed", 4), ("shown", 3))
    }
    assert min(seen["closed"]) < SHOWN <= min(seen["shown"])


def specimen(order, **changes):
    """The prior's median specimen with some of its parameters changed."""
    target = tubular().target(order)
    draws = dict(target.draws(target.prior.to_parameters(np.zeros((1, target.dimension)))))
    assert set(changes) <= set(draws)
    return draws | {name: np.array([value]) for name, value in changes.items()}


def test_the_signal_of_a_unit_is_what_the_next_smaller_model_misses():
    strong = specimen(2, E_2=10e6, tau_1=5e-3, tau_2=0.1)
    weak = specimen(2, E_2=3e10, tau_1=5e-3, tau_2=0.1)
    seen = signal(tubular(), 2, 1, strong)
    assert seen > 2 * SHOWN
    assert signal(tubular(), 2, 1, weak) < 1e-2
    assert signal(tubular(), 2, 2, strong) < 1e-6
    assert signal(tubular(), 1, 0, specimen(1)) == np.inf
    assert SHOWN < signal(tubular(), 2, 1, strong, with_error=True) < 0.9 * seen
    noise = {name: 3.0 * value for name, value in strong.items() if "sigma" in name}
    assert signal(tubular(), 2, 1, strong | noise) < 0.8 * seen


def test_the_signal_is_a_divergence_under_the_whole_covariance():
    """With dense covariances, at three points, and nothing found below the signal."""
    truth = specimen(2, E_2=10e6, tau_1=5e-3, tau_2=0.1)
    world = tubular()
    target = world.conditioned(1, true_curves(world, 2, truth))
    (record,) = target.records

    def covariance(draws):
        noise = {k: float(v[0]) for k, v in target.noise_draws(draws, record).items()}
        apart = np.abs(np.subtract.outer(record.noise_coordinate, record.noise_coordinate))
        correlated = noise["sigma_ou"] ** 2 * np.exp(-apart / noise["tau_ou"])
        return correlated + noise["sigma_white"] ** 2 * np.eye(len(apart))

    true_covariance = covariance(truth)
    known = [np.linalg.cholesky(true_covariance)]
    least = signal(world, 2, 1, truth)
    for z in np.random.default_rng(2).standard_normal((3, target.dimension)):
        draws = target.draws(target.prior.to_parameters(z[None]))
        misses = record.experiment.response - record.simulate(draws)[0]
        other = covariance(draws)
        solved = np.linalg.solve(other, np.column_stack([true_covariance, misses]))
        exact = np.trace(solved[:, :-1]) - len(other) + misses @ solved[:, -1]
        exact += np.linalg.slogdet(other)[1] - np.linalg.slogdet(true_covariance)[1]
        assert divergence(target, z, known, None) == pytest.approx(exact / 2, rel=1e-6)
        assert least < exact / 2
