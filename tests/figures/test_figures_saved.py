"""The results that figures are drawn from, and the files that they are saved as."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.faults import UserError
from deabayes.figures.results import StudyResults


def test_save_all_writes_svg_png_and_pdf_and_an_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {name: figures.REGISTRY[name] for name in ("residuals", "coverage", "errors")}
    monkeypatch.setattr(figures, "REGISTRY", few)
    study = write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",)))
    out = study / "figures"
    saved = figures.save_all(study, out)
    assert {(s.name, s.candidate, s.sheet) for s in saved} == {
        ("errors", "", 1),
        ("residuals", "kv_gm_1", 1),
        ("residuals", "kv_gm_1", 2),
        ("coverage", "kv_gm_1", 1),
    }
    for figure in saved:
        assert figure.svg.read_text().startswith("<?xml")
        assert figure.png.read_bytes().startswith(b"\x89PNG")
        assert figure.pdf.read_bytes().startswith(b"%PDF")
    assert len(json.loads((out / "index.json").read_text())) == len(saved)
    assert figures.saved_figures(study, out) == saved
    entries = json.loads((out / "index.json").read_text())
    older = [{k: v for k, v in entry.items() if k != "pdf"} for entry in entries]
    (out / "index.json").write_text(json.dumps(older))
    assert figures.saved_figures(study, out) is None, "of a version that wrote no PDF"
    (out / "index.json").write_text(json.dumps(entries))
    (study / "comparison.csv").touch()
    assert figures.saved_figures(study, out) is None


@pytest.mark.parametrize("converged", [True, False])
def test_other_candidates_have_the_figures_that_the_report_shows(
    tmp_path: Path, converged: bool
) -> None:
    fake = Fake(candidates=(1, 2), protocols=("relaxation",), converged=converged)
    study = StudyResults(write_study(tmp_path, fake))
    (other,) = (each for each in study.candidates if each is not study.recommended)
    assert figures.names_of(study.recommended) == figures.names("candidate")
    of_other = set(figures.OF_OTHERS) | (set() if converged else {"convergence"})
    assert set(figures.names_of(other)) == of_other


def test_unknown_figure_and_empty_study_are_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="did you mean 'residuals'"):
        figures.module("residual")
    with pytest.raises(UserError, match="holds no fitted candidate"):
        _ = StudyResults(tmp_path).candidates


def test_recommended_follows_the_verdict(tmp_path: Path) -> None:
    verdict = "not resolved by these data against kv_gm_1; the smallest order"
    study = StudyResults(
        write_study(
            tmp_path, Fake(candidates=(1, 2, 3), protocols=("relaxation",), verdict=verdict)
        )
    )
    assert study.recommended.name == "kv_gm_3"
