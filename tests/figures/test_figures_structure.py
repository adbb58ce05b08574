"""Figures of the minimum-energy structure's analyses, from made-up posteriors."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.text import Text
from tests.shared import structure_contexts as made_up
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures, papers
from deabayes.figures import pairs
from deabayes.figures.record import Record
from deabayes.figures.results import StudyResults
from deabayes.papers.minimum_energy_structure import genetic_algorithm

SYSTEM = "minimum_energy_structure"
OF_STRUCTURE = [
    name for name in figures.REGISTRY
    if getattr(figures.module(name), "ANALYSIS", "") in papers.names_for(SYSTEM)
]  # fmt: skip
STATIC = ("force_curve", "structure_film", "genetic_algorithm")
FAKE = Fake(candidates=(1, 2), protocols=("relaxation",), provenance="simulated")


class OfStructure(StudyResults):
    """Results that say they are of the structure."""

    system = SYSTEM


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("structure")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(genetic_algorithm, "SEEDS", (1, 2))
        patch.setattr(genetic_algorithm, "GENERATIONS", 5)
        found = {}
        for kind, context in (("static", made_up.static()), ("motion", made_up.motion())):
            found[kind] = write_study(folder / kind, FAKE)
            papers.run_all(context, found[kind] / "analyses")
        return found


def words(figure: object) -> list[str]:
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", OF_STRUCTURE)
def test_it_draws_marked_with_units_and_with_what_did_not_converge(
    name: str, analysed: dict[str, Path]
) -> None:
    kind = "static" if name in STATIC else "motion"
    drawn = figures.draw(name, OfStructure(analysed[kind]))
    assert drawn
    first = (made_up.STATIC if kind == "static" else made_up.MOVING)[0]
    for figure in drawn:
        found = words(figure)
        assert "simulated data" in found
        assert any(f"{first} (not converged)" in each for each in found)
        labels = [ax.get_xlabel() for ax in figure.axes]
        assert any("(" in label for label in labels), "no unit on any axis"


@pytest.mark.parametrize("name", OF_STRUCTURE)
def test_it_draws_nothing_where_nothing_was_computed(
    name: str, analysed: dict[str, Path], tmp_path: Path
) -> None:
    other = "motion" if name in STATIC else "static"
    assert figures.draw(name, OfStructure(analysed[other])) == []
    assert figures.draw(name, OfStructure(write_study(tmp_path, FAKE))) == []


def test_every_analysis_with_curves_has_a_figure(analysed: dict[str, Path]) -> None:
    drawn = {figures.module(name).ANALYSIS for name in OF_STRUCTURE}
    for folder in analysed.values():
        assert {e.name for e in StudyResults(folder).analyses if e.curve_names} <= drawn


def test_one_sheet_per_voltage_and_a_panel_per_frequency(analysed: dict[str, Path]) -> None:
    five, four = figures.draw("error_against_phase", OfStructure(analysed["motion"]))
    assert any("5 kV, 10 Hz, calibration" in each for each in words(five))
    assert any("4 kV, 1 Hz, held out" in each for each in words(four))
    assert len(five.axes) == len(four.axes) == 6


def test_what_lies_before_a_gap_is_not_joined_to_what_is_shown() -> None:
    prediction = xr.Dataset(
        {"excitation": ("coordinate", np.ones(40))},
        {"coordinate": np.r_[np.arange(20.0), np.arange(100.0, 120.0)]},
        {"experiment": "sine", "protocol": "sine"},
    )
    assert Record(prediction).shown == slice(20, None)
    whole = prediction.assign_coords(coordinate=np.arange(40.0))
    assert Record(whole).shown == slice(None)
    step = prediction.assign_attrs(protocol="step")
    assert Record(step).shown == slice(None)


def test_long_tails_do_not_set_the_limits_of_pairs() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal(5000)
    low, high = pairs._Column(values, "", False).limits(0.002)
    assert (low, high) == pytest.approx(tuple(np.quantile(values, [0.002, 0.998])))
    long = np.append(values, [*np.full(50, 1e4), np.inf, np.nan])
    low, high = pairs._Column(long, "", False).limits(0.002)
    assert low > -4.0 and high < 6.0


def test_pairs_that_span_decades_have_logarithmic_axes() -> None:
    rng = np.random.default_rng(1)
    wide = 10 ** rng.normal(2.0, 0.5, 4000)
    columns = [
        pairs._Column(np.log10(wide), "wide", True),
        pairs._Column(1.0 + 0.01 * np.log10(wide), "narrow", False),
    ]
    figure = Figure()
    axes = figure.subplots(2, 2, squeeze=False, sharex="col")
    for row, column in ((0, 0), (1, 0), (1, 1)):
        y = columns[row] if column < row else None
        pairs._cell(axes[row, column], columns[column], y)
        pairs._label(axes[row, column], columns, row, column, 6.0)
    assert [axes[1, 0].get_xscale(), axes[1, 0].get_yscale()] == ["log", "linear"]
    low, high = axes[1, 0].get_xlim()
    assert (low, high) == pytest.approx(tuple(np.quantile(wide, [0.002, 0.998])), rel=0.05)
    region = axes[1, 0].collections[0].get_paths()[0].vertices
    assert low < region[:, 0].min() and region[:, 0].max() < high
    ends = np.quantile(wide, [0.05, 0.95])
    assert (region[:, 0].min(), region[:, 0].max()) == pytest.approx(tuple(ends), rel=0.25)
    assert np.corrcoef(np.log10(region[:, 0]), region[:, 1])[0, 1] > 0.85


def test_draws_of_either_sign_have_linear_axes() -> None:
    values = np.concatenate([np.linspace(-1.0, 0.9, 40), np.linspace(1.0, 100.0, 960)])
    results = SimpleNamespace(
        posterior={"x": xr.DataArray(values)}, label=lambda _: {"unit": "1", "symbol": "x"}
    )
    column = pairs._column(results, "x")
    assert not column.log
    np.testing.assert_array_equal(column.drawn, values)
