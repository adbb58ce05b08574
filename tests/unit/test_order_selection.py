"""A replicate of the order selection, from simulated records to a row, with draws made up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from tests.validation import order_selection
from tests.validation.sampled import Sampled

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
    row = order_selection.replicate(TASK)
    assert row["outcome"] in ("right", "wrong", "not resolved")
    assert row["chosen"] in ("voigt_kelvin_1", "voigt_kelvin_2", "voigt_kelvin_3")
    assert row["right"] == "voigt_kelvin_1" and row["all_converged"] == 1
    for order in order_selection.CANDIDATES:
        assert np.isfinite(float(row[f"log_evidence:{order}"]))
        assert np.isfinite(float(row[f"elpd:{order}"]))


def test_what_did_not_converge_is_not_ranked(monkeypatch):
    only_first = made_up(lambda target: target.system.order == 1)
    monkeypatch.setattr(order_selection, "sample", only_first)
    row = order_selection.replicate(TASK)
    assert row["outcome"] == "no verdict" and row["elpd:2"] == "" and row["all_converged"] == 0


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
