"""What the verdict on model order cannot exclude, in the report's words."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from deabayes.report import words


@pytest.fixture
def study(monkeypatch):
    """Two candidates, two records, with noise of given sizes."""

    def of(noises, candidates=2):
        monkeypatch.setattr(words, "sizes", lambda results: noises)
        table = pd.DataFrame({"verdict": ["chosen"] * candidates})
        return SimpleNamespace(comparison=table, recommended=SimpleNamespace(name="kv_gm_1"))

    return of


def test_the_record_with_most_correlated_noise_is_named(study):
    noises = {
        "slow": {"correlated": 0.0123, "white": 0.0008},
        "fast": {"correlated": 0.002, "white": 0.003},
    }
    said = words.may_hide(study(noises))
    assert "takes what kv_gm_1 leaves: 1.2 % of the range in slow, the most" in said
    assert "white noise of 0.080 %" in said


def test_of_one_record_and_no_white_noise_no_more_is_said(study):
    said = words.may_hide(study({"slow": {"correlated": 0.02}}))
    assert "2.0 % of the range in slow. A further unit" in said


def test_nothing_is_said_where_white_noise_is_all_there_is(study):
    assert words.may_hide(study({"slow": {"correlated": 0.001, "white": 0.003}})) == ""
    assert words.may_hide(study({"slow": {"white": 0.003}})) == ""


def test_nothing_is_said_where_nothing_is_compared(study):
    noises = {"slow": {"correlated": 0.02, "white": 0.001}}
    assert words.may_hide(study(noises, candidates=1)) == ""
    assert words.may_hide(SimpleNamespace(comparison=None)) == ""
