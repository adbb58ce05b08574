"""A record that the prior does not expect is said in the posterior file, and so in the report."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.unit.test_predict_with import STUDY, UNCERTAIN, creep

from deabayes.pipeline import identify
from deabayes.posterior import build
from deabayes.posteriors import content


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1.0, ()),
        (-1.0, ("creep: strain falls where the prior expects it to rise; is its sign right?",)),
        (1e3, ("creep: strain reaches ",)),
    ],
)
def test_what_the_prior_does_not_expect_is_among_the_warnings_of_the_fit(
    monkeypatch: pytest.MonkeyPatch, factor: float, said: tuple[str, ...]
) -> None:
    monkeypatch.setattr(content, "convergence_summary", lambda _: {})
    record = replace(creep(), response=factor * creep().response)
    target = build(STUDY, "voigt_kelvin_2", UNCERTAIN, [record])
    z = np.zeros((1, 2, target.dimension))
    pooled = SimpleNamespace(
        thinned=lambda _: (z, np.zeros((1, 2))), convergence=SimpleNamespace(table=None)
    )
    found = identify._content(STUDY, "voigt_kelvin_2", target, pooled)
    odd = [text for text in found.warnings if "the prior expects it" in text or "reaches" in text]
    assert len(odd) == len(said)
    assert all(text.startswith(start) for text, start in zip(odd, said, strict=True))
