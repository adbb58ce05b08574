"""The page of words explains every statistical column of the results' tables."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"
PLAIN = {
    *"parameter symbol unit mean sd experiment role protocol candidate n_parameters".split(),
    *"differs_in elpd_difference_se log_evidence_nested log_evidence_nested_error".split(),
    *"e_rms_q05 e_rms_q95 e_m_q05 e_m_q95".split(),
}
"""Columns that need no word, or of which another column's says enough."""


@pytest.mark.parametrize("table", ["summary.csv", "errors.csv", "comparison.csv"])
def test_every_column_has_its_word(table: str) -> None:
    files = (DOCS / "files.md").read_text(encoding="utf-8")
    listed = re.search(rf"\n`{re.escape(table)}`\n: (.*?)(?:\.\s|\n\n)", files, re.DOTALL)
    assert listed is not None
    columns = re.findall(r"\w+", re.sub(r"\([^)]*\)", "", listed[1]))
    assert len(columns) > 10
    words = (DOCS / "words.md").read_text(encoding="utf-8")
    assert [name for name in columns if name not in PLAIN and f"`{name}`" not in words] == []
