"""Files of figures: text that is text, names in the metadata, the same bytes in every run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox
from PIL import Image
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

import deabayes
from deabayes import figures
from deabayes.figures import style
from deabayes.figures.results import CandidateResults, StudyResults

PRODUCT = f"deabayes {deabayes.__version__}"
DATES = re.compile(rb"<dc:date>|CreationDate|ModDate|tIME|Creation Time")


@pytest.fixture(scope="module")
def candidate(tmp_path_factory: pytest.TempPathFactory) -> CandidateResults:
    fake = Fake(candidates=(1,), protocols=("relaxation",), provenance="simulated")
    return StudyResults(write_study(tmp_path_factory.mktemp("study"), fake)).recommended


@pytest.fixture(scope="module")
def saved(
    candidate: CandidateResults, tmp_path_factory: pytest.TempPathFactory
) -> figures.SavedFigure:
    """The marginals, whose labels hold mathematical symbols."""
    (figure,) = figures._save("marginals", candidate, tmp_path_factory.mktemp("one"), False)
    return figure


def test_text_of_an_svg_is_text_with_fonts_to_fall_back_on(saved: figures.SavedFigure) -> None:
    svg = saved.svg.read_text(encoding="utf-8")
    assert ">prior</text>" in svg and ">μ</tspan>" in svg
    fonts = re.findall(r"font-family: ([^;\"]*)", svg)
    assert len(fonts) > 20
    assert set(fonts) == {", ".join([*map(repr, style.FONTS), "sans-serif"])}


def test_fonts_of_a_pdf_are_embedded_truetype_fonts(saved: figures.SavedFigure) -> None:
    pdf = saved.pdf.read_bytes()
    assert b"/FontFile2" in pdf, "a TrueType font"
    assert b"/Type3" not in pdf and b"/FontFile3" not in pdf


def test_title_maker_study_and_candidate_are_in_the_metadata(saved: figures.SavedFigure) -> None:
    svg, pdf = saved.svg.read_text(encoding="utf-8"), saved.pdf.read_bytes()
    title = f"{saved.title}, fake_strip, kv_gm_1"
    assert f"<dc:title>{title}</dc:title>" in svg and f"<dc:title>{PRODUCT}</dc:title>" in svg
    assert "<rdf:li>fake_strip</rdf:li>" in svg and "<rdf:li>kv_gm_1</rdf:li>" in svg
    for key, value in (("Title", title), ("Creator", PRODUCT), ("Keywords", "fake_strip, kv_gm_1")):
        assert f"/{key} ({value})".encode() in pdf
        assert Image.open(saved.png).info[key] == value


def test_files_are_the_same_in_every_run(
    saved: figures.SavedFigure, candidate: CandidateResults, tmp_path: Path
) -> None:
    (again,) = figures._save("marginals", candidate, tmp_path, False)
    for kind in figures.FILES:
        content = getattr(saved, kind).read_bytes()
        assert content == getattr(again, kind).read_bytes()
        assert not DATES.search(content)


@pytest.mark.parametrize("name", ["marginals", "preparation"])
def test_noise_in_the_last_digits_of_the_layout_does_not_reach_the_files(
    candidate: CandidateResults, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The layout's solver is not exact, and its rounding errors differ from run to run."""
    kept, places = ConstrainedLayoutEngine.execute, []
    for error in (0.0, 1e-13):

        def execute(engine: ConstrainedLayoutEngine, figure: Figure, error: float = error) -> None:
            kept(engine, figure)
            for part in figure.subfigs:
                part.bbox_relative.set_points(part.bbox_relative.get_points() + error)
            for ax in figure.axes:
                place = ax.get_position(original=True)
                ax._set_position(Bbox(place.get_points() + error))

        monkeypatch.setattr(ConstrainedLayoutEngine, "execute", execute)
        results = candidate.study if name == "preparation" else candidate
        (figure,) = figures.draw(name, results)
        places.append([ax.get_window_extent().bounds for ax in figure.axes])
    assert places[0] == places[1]


@pytest.mark.parametrize("named", [False, True])
def test_names_are_drawn_if_they_are_asked_for(candidate: CandidateResults, named: bool) -> None:
    (figure,) = figures.draw("marginals", candidate, named)
    words = [text.get_text() for text in figure.texts]
    assert ("fake_strip  ·  kv_gm_1" in words) is named
    assert "simulated data" in words


def test_a_figure_without_words_above_the_axes_has_no_strip_for_them(
    candidate: CandidateResults,
) -> None:
    plain, with_strip = (figures.module("marginals").draw(candidate)[0] for _ in range(2))
    height = plain.get_size_inches()[1]
    style.finish(plain)
    style.finish(with_strip, "fake_strip")
    assert plain.get_size_inches()[1] == height
    assert with_strip.get_size_inches()[1] == pytest.approx(height + style.HEADER)
