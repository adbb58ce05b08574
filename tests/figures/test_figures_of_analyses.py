"""Figures that draw analyses: every one draws what was computed, and nothing where nothing was."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.text import Text
from tests.shared import contexts
from tests.shared import structure_contexts as structures
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures, papers
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers.minimum_energy_structure import genetic_algorithm

FAKE = Fake(candidates=(1, 2), protocols=("relaxation",), provenance="simulated")
AT_REST = ("force_curve", "structure_film", "genetic_algorithm")
CANDIDATES = {
    "membrane": contexts.CANDIDATES, "at_rest": structures.STATIC, "moving": structures.MOVING
}  # fmt: skip
"""Candidates of the made-up studies; the first of a study did not converge."""


def of_system(system: str) -> list[str]:
    """Figures of the system's analyses; influence is tested in test_influence.py."""
    return [
        name
        for name in figures.REGISTRY
        if getattr(figures.module(name), "ANALYSIS", "influence") != "influence"
        and figures.module(name).ANALYSIS in papers.names_for(system)
        and system in getattr(figures.module(name), "SYSTEMS", (system,))
    ]


OF_STRUCTURE = of_system("minimum_energy_structure")
DRAWN = [
    *((name, "membrane") for name in of_system("membrane")),
    *((name, "at_rest" if name in AT_REST else "moving") for name in OF_STRUCTURE),
]
OTHER = {"at_rest": "moving", "moving": "at_rest", "membrane": "bare"}


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, StudyResults]:
    """Analysed studies of a membrane and of a structure, and one without analyses."""
    folder = tmp_path_factory.mktemp("analysed")
    made = {name: write_study(folder / name, FAKE) for name in ("bare", *CANDIDATES)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(genetic_algorithm, "SEEDS", (1, 2))
        patch.setattr(genetic_algorithm, "GENERATIONS", 5)
        for name, context in (("at_rest", structures.static()), ("moving", structures.motion())):
            papers.run_all(context, made[name] / "analyses")
        others = {n: path for n, path in papers.REGISTRY.items() if n != "influence"}
        patch.setattr(papers, "REGISTRY", others)
        papers.run_all(contexts.context(), made["membrane"] / "analyses")
    return {name: StudyResults(path) for name, path in made.items()}


def words(figure: object) -> list[str]:
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]  # type: ignore[attr-defined]


@pytest.mark.parametrize(("name", "study"), DRAWN)
def test_a_figure_is_marked_and_has_units_and_candidates(
    name: str, study: str, studies: dict[str, StudyResults]
) -> None:
    drawn = figures.draw(name, studies[study])
    assert drawn
    for figure in drawn:
        found = words(figure)
        assert "simulated data" in found
        assert any(f"{CANDIDATES[study][0]} (not converged)" in each for each in found)
        assert study != "membrane" or CANDIDATES[study][1] in found
        assert all(ax.get_legend() is None for ax in figure.axes)
        labels = [ax.get_xlabel() for ax in figure.axes]
        assert any("(" in label for label in labels), "no unit on any axis"


@pytest.mark.parametrize(("name", "study"), DRAWN)
def test_nothing_is_drawn_where_nothing_was_computed(
    name: str, study: str, studies: dict[str, StudyResults]
) -> None:
    assert figures.draw(name, studies[OTHER[study]]) == figures.draw(name, studies["bare"]) == []


def test_every_analysis_with_curves_has_a_figure(studies: dict[str, StudyResults]) -> None:
    drawn = {figures.module(name).ANALYSIS for name, _ in DRAWN}
    for study in studies.values():
        assert {each.name for each in study.analyses if each.curve_names} <= drawn


def test_one_sheet_per_voltage_and_a_panel_per_frequency(
    studies: dict[str, StudyResults],
) -> None:
    five, four = figures.draw("error_against_phase", studies["moving"])
    assert any("5 kV, 10 Hz, calibration" in each for each in words(five))
    assert any("4 kV, 1 Hz, held out" in each for each in words(four))
    assert len(five.axes) == len(four.axes) == 6


def test_a_saved_figure_knows_its_analysis(
    studies: dict[str, StudyResults], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {name: figures.REGISTRY[name] for name in ("amplitude_frequency", "errors")}
    monkeypatch.setattr(figures, "REGISTRY", few)
    saved = figures.save_all(studies["membrane"].folder, tmp_path)
    kept = {s.name: s.analysis for s in saved}
    assert kept == {"amplitude_frequency": "amplitude_frequency", "errors": ""}
    assert len(json.loads((tmp_path / "index.json").read_text())) == 2


def test_markers_do_not_run_out() -> None:
    """A study may have more candidates than there are markers."""
    several = [panels.marker(k) for k in range(3 * len(style.MARKERS))]
    pairs = {(panels.colour(k), marker) for k, marker in enumerate(several)}
    assert len(pairs) == len(several)
