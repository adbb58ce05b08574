"""A replicate of the order selection, from simulated records to a row, with draws made up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from tests.validation import order_selection
from tests.validation.sampled import Sampled
from tests.validation.tally import verdict

from deabayes.comparison import decide
from deabayes.ranking import score_all

TASK = {"family": "voigt_kelvin", "world": "closed", "truth": 1, "replicate": 0}


def made_up(converged):
    """A sampler whose draws lie about the best of a few hundred draws of the prior."""

    def sample(target, seed):
        rng = np.random.default_rng(seed)
        tried = rng.standard_normal((400, target.dimension))
        best = tried[np.argmax(target(tried))]
        chain = best + 0.02 * rng.standard_normal((2, 50, 4, target.dimension))
        convergence = SimpleNamespace(
            converged=converged(target), table=pd.DataFrame({"ess_bulk": [200.0]})
        )
        return Sampled(target, SimpleNamespace(chain=chain, convergence=convergence), 1.0)

    return sample


def test_a_replicate_is_decided_by_the_shipped_rule(monkeypatch):
    monkeypatch.setattr(order_selection, "sample", made_up(lambda target: True))
    decided = []
    monkeypatch.setattr(
        order_selection, "score_all", lambda r: decided.append(score_all(r)) or decided[0]
    )
    row = order_selection.replicate(TASK)
    found = verdict({**TASK, **row})
    assert found["right"] == "voigt_kelvin_1" and found["all_converged"]
    assert found["chosen"] == decide(decided[0]).chosen
    blocks = {len(row[f"terms:{order}"].split()) for order in order_selection.CANDIDATES}
    assert len(blocks) == 1 and blocks.pop() > 5
    for order, score in zip(order_selection.CANDIDATES, decided[0], strict=True):
        assert float(row[f"log_evidence:{order}"]) == pytest.approx(score.log_evidence, abs=1e-3)
        terms = np.array(row[f"terms:{order}"].split(), float)
        np.testing.assert_allclose(terms, score.loo.terms, atol=1e-3)


def test_what_did_not_converge_is_not_ranked(monkeypatch):
    only_first = made_up(lambda target: target.system.order == 1)
    monkeypatch.setattr(order_selection, "sample", only_first)
    row = order_selection.replicate(TASK)
    assert row["terms:1"] and row["terms:2"] == ""
    found = verdict({**TASK, **row})
    assert found["outcome"] == "no verdict" and not found["all_converged"]


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
