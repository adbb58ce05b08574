"""Replicates kept as rows, likelihoods in batches, and draws compared: parts of the long checks."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.comparison.nested import Batched
from tests.validation import rows
from tests.validation.nested import parameter_rows
from tests.validation.recovery import comparison

TASKS = [{"order": 2, "replicate": index} for index in range(4)]


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    path = tmp_path / "out.csv"
    assert rows.missing(path, TASKS) == TASKS
    for task in (TASKS[0], TASKS[2]):
        rows.write(path, {**task, "value": 1.5, **rows.provenance(7)})
    assert rows.missing(path, TASKS) == [TASKS[1], TASKS[3]]
    assert [row["seed"] for row in rows.read(path)] == ["7", "7"]


def test_rows_with_other_columns_are_refused(tmp_path):
    path = tmp_path / "out.csv"
    rows.write(path, {"replicate": 0, "value": 1})
    with pytest.raises(ValueError, match="other"):
        rows.write(path, {"replicate": 1, "other": 1})
    assert len(list(rows.read(path))) == 1


def test_batched_chains_get_their_own_values_in_full_batches():
    sizes = []

    def log_likelihood(z):
        sizes.append(len(z))
        return -np.sum(z**2, axis=1)

    batched = Batched(log_likelihood, 4)

    def chain(length):
        return [batched(np.array([float(length), float(k)])) for k in range(length)]

    lengths = [3, 1, 5, 2, 4]
    found = batched.map(chain, lengths)
    assert found == [[-(n**2.0) - k**2.0 for k in range(n)] for n in lengths]
    assert sizes == [4, 3, 2, 1, 1, *[1] * 4]
    assert batched.evaluations == sum(lengths)


def test_a_chain_that_fails_does_not_hang_the_others():
    batched = Batched(lambda z: z[:, 0], 3)

    def chain(start):
        if start == 1.0:
            raise RuntimeError("lost")
        return [batched(np.array([start])) for _ in range(3)]

    with pytest.raises(RuntimeError, match="lost"):
        batched.map(chain, [0.0, 1.0, 2.0])


def test_comparison_with_a_truth():
    draws = np.exp(np.random.default_rng(1).normal(2.0, 0.5, 40_000))
    found = comparison("mu", draws, draws[:99], float(np.exp(2.0)))
    assert found["in50:mu"] == 1 and 35 < found["rank:mu"] < 65
    assert float(found["bias:mu"]) == pytest.approx(0.0, abs=0.02)
    far = comparison("mu", draws, draws[:99], float(np.exp(1.0)))
    assert far["in90:mu"] == 0 and float(far["bias:mu"]) == pytest.approx(2.0, abs=0.03)


def test_differences_are_in_standard_deviations():
    rng = np.random.default_rng(2)
    theirs = np.exp(rng.normal(0.0, 0.2, (50_000, 1)))
    (row,) = parameter_rows(("mu",), np.exp(rng.normal(0.1, 0.4, (50_000, 1))), theirs, 100.0)
    assert float(row["mean_difference_sd"]) == pytest.approx(0.5, abs=0.03)
    assert float(row["sd_ratio"]) == pytest.approx(2.0, abs=0.03)
    assert row["standard_error_sd"] == "0.1000"
