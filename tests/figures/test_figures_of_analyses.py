"""Figures that draw analyses: every one draws what was computed, and nothing where nothing was."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.text import Text
from tests.shared.contexts import CANDIDATES, context
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures, papers
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

OF_MEMBRANE = [
    name for name in figures.REGISTRY
    if getattr(figures.module(name), "ANALYSIS", "") in papers.names_for("membrane")
    and "membrane" in getattr(figures.module(name), "SYSTEMS", ("membrane",))
]  # fmt: skip
OF_POSTERIORS = [n for n in OF_MEMBRANE if figures.module(n).ANALYSIS != "influence"]
"""Influence is that of the prior: tested in test_influence_analysis.py."""
FAKE = Fake(candidates=(1, 2), protocols=("relaxation",), provenance="simulated")


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    study = write_study(tmp_path_factory.mktemp("analysed"), FAKE)
    papers.run_all(context(), study / "analyses")
    return study


def words(figure: object) -> list[str]:
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", OF_POSTERIORS)
def test_it_draws_marked_and_with_every_candidate(name: str, analysed: Path) -> None:
    drawn = figures.draw(name, StudyResults(analysed))
    assert drawn
    for figure in drawn:
        found = words(figure)
        assert "simulated data" in found
        assert f"{CANDIDATES[0]} (not converged)" in found
        assert CANDIDATES[1] in found
        assert all(ax.get_legend() is None for ax in figure.axes)
        labels = [ax.get_xlabel() for ax in figure.axes]
        assert any("(" in label for label in labels), "no unit on any axis"


@pytest.mark.parametrize("name", OF_MEMBRANE)
def test_it_draws_nothing_where_nothing_was_computed(name: str, tmp_path: Path) -> None:
    assert figures.draw(name, StudyResults(write_study(tmp_path, FAKE))) == []


def test_every_analysis_with_curves_has_a_figure(analysed: Path) -> None:
    drawn = {figures.module(name).ANALYSIS for name in OF_MEMBRANE}
    assert {each.name for each in StudyResults(analysed).analyses if each.curve_names} <= drawn


def test_a_saved_figure_knows_its_analysis(
    analysed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {name: figures.REGISTRY[name] for name in ("amplitude_frequency", "errors")}
    monkeypatch.setattr(figures, "REGISTRY", few)
    saved = figures.save_all(analysed, tmp_path)
    kept = {s.name: s.analysis for s in saved}
    assert kept == {"amplitude_frequency": "amplitude_frequency", "errors": ""}
    assert len(json.loads((tmp_path / "index.json").read_text())) == 2


def test_markers_do_not_run_out() -> None:
    """A study may have more candidates than there are markers."""
    several = [panels.marker(k) for k in range(3 * len(style.MARKERS))]
    pairs = {(panels.colour(k), marker) for k, marker in enumerate(several)}
    assert len(pairs) == len(several)
