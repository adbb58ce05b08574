"""A record that the prior does not expect is said by the fit, in posterior file and report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from tests.posteriors.test_predict_with import STUDY, UNCERTAIN, creep

from deabayes.checks.priors import unexpected
from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.inference.log_posterior import build
from deabayes.pipeline import fit
from deabayes.posteriors import content
from deabayes.sampling.problem import EveryDrawFailed


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
    found = fit._content(STUDY, "voigt_kelvin_2", target, pooled)
    odd = [text for text in found.warnings if "the prior expects it" in text or "reaches" in text]
    assert len(odd) == len(said)
    assert all(text.startswith(start) for text, start in zip(odd, said, strict=True))


@pytest.mark.parametrize(
    ("offset", "said"), [(0.9, False), (-0.9, False), (1.6, True), (-1.6, True), (8.0, True)]
)
def test_a_record_that_does_not_begin_at_zero_is_warned_of(offset: float, said: bool) -> None:
    """By more than the record's range at the first reading, where the tube is at rest."""
    step, strain = creep(), np.r_[0.0, 0.0, creep().response]
    driven = replace(
        step.excitation, coordinate=np.array([0.0, 0.1, 0.1, 0.6]),
        values=np.array([0.0, 0.0, 2e3, 2e3]),
    )  # fmt: skip
    moved = replace(
        step, coordinate=np.r_[0.0, 0.05, 0.1 + step.coordinate], excitation=driven,
        response=strain + offset * np.ptp(strain), samples_averaged=np.ones(strain.size),
    )  # fmt: skip
    system = build(STUDY, "voigt_kelvin_2", UNCERTAIN, [step]).system
    found = [text for text in unexpected(STUDY, system, [moved]) if "begins at" in text]
    assert len(found) == said
    assert all("strain begins at" in text and "`baseline`" in text for text in found)


OUTPUTS = Path("posterior.nc"), Path("summary.csv")


@pytest.mark.parametrize("lost", ["creep", "all records at once"])
def test_a_fit_that_cannot_begin_names_study_candidate_and_records(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lost: str
) -> None:
    def log_likelihood(theta: FloatArray, _: list[str]) -> FloatArray:
        return np.full(len(theta), np.nan if lost == "creep" else 0.0)

    def sample(*_: object) -> None:
        raise EveryDrawFailed

    real = build(STUDY, "voigt_kelvin_2", UNCERTAIN, [creep()])
    target = MagicMock(prior=real.prior, records=real.records, log_likelihood=log_likelihood)
    monkeypatch.setattr(fit, "build_target", lambda *_: target)
    monkeypatch.setattr(fit, "chain_folder", lambda *_: tmp_path)
    monkeypatch.setattr("deabayes.sampling.engine.sample", sample)
    monkeypatch.setattr("deabayes.posteriors.problem.problem_of", lambda _: None)
    said = f"study creep, voigt_kelvin_2: no draw of the prior has a response to {lost}; are the"
    with pytest.raises(UserError, match=said):
        fit.fit_candidate(STUDY, "voigt_kelvin_2", tmp_path, *OUTPUTS, False)
