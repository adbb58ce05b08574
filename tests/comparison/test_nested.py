"""Nested sampling against evidence in closed form, and what is said where methods disagree."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from deabayes.comparison.decision import Score, evidence_conflict
from deabayes.comparison.nested import nested
from deabayes.faults import UserError


def test_the_evidence_of_a_normal_model():
    """y = A z + e, z ~ N(0, I), e ~ N(0, I): log N(y; 0, A A^T + I)."""
    rng = np.random.default_rng(3)
    design = rng.normal(size=(6, 2))
    y = design @ np.array([0.5, -1.0]) + rng.normal(size=6)
    exact = multivariate_normal(np.zeros(6), design @ design.T + np.eye(6)).logpdf(y)

    def log_likelihood(z):
        return -0.5 * np.sum((y - z @ design.T) ** 2, axis=1) - 3.0 * np.log(2.0 * np.pi)

    results, _ = nested(log_likelihood, 2, np.random.SeedSequence(4), live=200)
    error = float(results.logzerr[-1])
    assert 0.0 < error < 0.3
    assert float(results.logz[-1]) == pytest.approx(exact, abs=3 * error)


def test_without_dynesty_one_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "dynesty", None)
    with pytest.raises(UserError, match=r"needs the package dynesty; `pip install"):
        nested(lambda z: -np.sum(z**2, axis=1), 2, np.random.SeedSequence(1))


@pytest.mark.parametrize(
    ("nested_evidence", "error", "conflict"),
    [
        (10.6, 0.1, ""),
        (10.7, 0.1, "-0.7"),
        (9.3, 0.1, "+0.7"),
        (10.7, 0.3, ""),
        (np.nan, np.nan, ""),
    ],
)
def test_bridge_and_nested_may_differ_by_half_a_nat_and_their_errors(
    nested_evidence, error, conflict
):
    score = Score("a", 1, 3, True, 10.0, 0.05, 0.0, 0.0, None, nested_evidence, error)
    found = evidence_conflict(score)
    assert found == "" if not conflict else f"differ by {conflict}" in found
