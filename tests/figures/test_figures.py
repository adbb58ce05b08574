"""Figures: every one of the registry draws from files, marked as it must be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures import panels, style
from deabayes.figures.record import Record, branches, side_by_side
from deabayes.figures.results import StudyResults
from deabayes.noise import REGISTRY as NOISE_MODELS

OF_CANDIDATES = [
    n
    for n in figures.names("candidate")
    if not hasattr(figures.module(n), "ANALYSIS") and not hasattr(figures.module(n), "SYSTEMS")
]
"""Those that need no analysis, and no system, that these studies do not have."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("measured")
    return StudyResults(write_study(folder, Fake(candidates=(1, 2))))


@pytest.fixture(scope="module")
def unconverged(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    fake = Fake(
        name="fake_tube",
        provenance="simulated",
        converged=False,
        candidates=(1, 2),
        protocols=("creep", "sine", "sine"),
        extrapolation="voltage 0 to 3500 V lies outside the calibrated 0 to 2500 V",
    )
    return StudyResults(write_study(tmp_path_factory.mktemp("unconverged"), fake))


def texts(figure: object) -> list[str]:
    from matplotlib.text import Text

    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", OF_CANDIDATES)
def test_every_candidate_figure_draws(name: str, measured: StudyResults) -> None:
    drawn = figures.draw(name, measured.recommended)
    assert drawn
    for figure in drawn:
        words = texts(figure)
        assert not any("fake_strip" in word for word in words), "the study's name is not asked for"
        assert "NOT CONVERGED" not in words
        assert "simulated data" not in words
        assert all(ax.get_legend() is None for ax in figure.axes), "a legend on the data"


@pytest.mark.parametrize("name", OF_CANDIDATES)
def test_unconverged_and_simulated_are_marked(name: str, unconverged: StudyResults) -> None:
    for figure in figures.draw(name, unconverged.recommended):
        assert "NOT CONVERGED" in texts(figure)
        assert "simulated data" in texts(figure)


@pytest.mark.parametrize("name", ["comparison", "errors", "preparation"])
def test_study_figures_name_unconverged_candidates(name: str, unconverged: StudyResults) -> None:
    for figure in figures.draw(name, unconverged):
        words = " ".join(texts(figure))
        assert "not converged" in words or name == "preparation"
        assert "simulated data" in words


def test_error_axis_reaches_the_worst_held_out_record(tmp_path: Path) -> None:
    study = write_study(tmp_path)
    worst = 0.0
    for path in study.glob("*/errors.csv"):
        table = pd.read_csv(path)
        columns = ["e_rms_percent", "e_rms_q05", "e_rms_q95"]
        table.loc[table["role"] == "validate", columns] *= 10.0
        table.to_csv(path, index=False)
        worst = max(worst, table["e_rms_q95"].max())
    (figure,) = figures.draw("errors", StudyResults(study))
    for ax in figure.axes:
        assert ax.get_xlim()[0] == 0.0
        assert ax.get_xlim()[1] > worst


def test_comparison_shows_the_verdict(measured: StudyResults) -> None:
    (figure,) = figures.draw("comparison", measured)
    assert any("smallest order the data cannot do without" in word for word in texts(figure))


def test_comparison_where_none_is_ranked_says_so_of_all(unconverged: StudyResults) -> None:
    (figure,) = figures.draw("comparison", unconverged)
    (verdict,) = (word for word in texts(figure) if "no candidate is ranked" in word)
    for name in unconverged.comparison.index:
        assert f"{name}: not converged" in " ".join(verdict.split())


def test_a_lone_ranked_candidate_is_not_magnified_to_rounding(tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(protocols=("relaxation",)))
    table = pd.read_csv(study / "comparison.csv")
    table["converged"] = [False] * (len(table) - 1) + [True]
    table.to_csv(study / "comparison.csv", index=False)
    (figure,) = figures.draw("comparison", StudyResults(study))
    for ax in figure.axes:
        assert ax.get_xlim()[0] <= -1.0
        assert ax.get_xlim()[1] >= 1.0


def test_extrapolation_is_flagged_on_held_out_panels_only(unconverged: StudyResults) -> None:
    (figure,) = figures.draw("data_and_bands", unconverged.recommended)
    assert texts(figure).count("EXTRAPOLATION") == 1


def test_three_bands_are_labelled_and_only_one_is_predictive(measured: StudyResults) -> None:
    (figure,) = figures.draw("data_and_bands", measured.recommended)
    words = texts(figure)
    assert any(word.startswith("90 % predictive") for word in words)
    assert any("parameters only (not predictive)" in word for word in words)
    assert any("discrepancy" in word and "predictive" not in word for word in words)


def test_parameter_panels_show_posterior_and_prior_with_units(measured: StudyResults) -> None:
    (figure,) = figures.draw("marginals", measured.recommended)
    assert r"$\mu_\alpha$ (kPa)" in texts(figure)


def test_many_records_are_spread_over_sheets() -> None:
    assert [len(b) for b in panels.batches(list(range(18)))] == [9, 9]
    assert [len(b) for b in panels.batches(list(range(10)))] == [5, 5]
    assert [len(b) for b in panels.batches([])] == [0]


def test_loops_are_split_where_they_turn() -> None:
    stretch = np.array([1.0, 1.5, 2.0, 2.0, 1.5, 1.0])
    parts = [stretch[part].tolist() for part in branches(stretch)]
    assert len(parts) == 2
    assert [part[-1] for part in parts] == [2.0, 1.0]
    assert all(np.all(np.diff(p) >= 0) or np.all(np.diff(p) <= 0) for p in parts)


def test_axes_follow_the_protocol(measured: StudyResults, unconverged: StudyResults) -> None:
    predictions = [Record(p) for p in measured.recommended.predictions.values()]
    loop = next(r for r in predictions if r.protocol == "load_unload")
    relaxation = next(r for r in predictions if r.protocol == "relaxation")
    assert loop.horizontal().label == "stretch"
    assert loop.against_coordinate().label == "time (s)"
    assert relaxation.horizontal().logarithmic
    assert relaxation.horizontal().label == "time since the step (s)"
    sine = next(
        Record(p)
        for p in unconverged.recommended.predictions.values()
        if p.attrs["protocol"] == "sine"
    )
    assert sine.label == "strain (%)"
    assert np.ptp(sine.horizontal().values) == pytest.approx(60.0, rel=0.02)


def test_records_side_by_side_share_a_unit_that_suits_them(measured: StudyResults) -> None:
    first = next(iter(measured.recommended.predictions.values()))
    first = first.assign_attrs(response_name="displacement", response_unit="m")
    share = first["observed"] / np.abs(first["observed"]).max()
    sizes = {"large": 2.5e-3, "medium": 0.4e-3, "small": 20e-6}
    shown = side_by_side(first.assign(observed=size * share) for size in sizes.values())
    assert [record.unit.label for record in shown] == ["mm", "mm", "µm"]
    assert np.abs(shown[1].response("observed")).max() == pytest.approx(0.4)
    # Another response does not count, and alone a record has the unit of its own size.
    other = first.assign_attrs(response_name="force", response_unit="N")
    alone = side_by_side([first.assign(observed=4e-4 * share), other])
    assert [record.unit.label for record in alone] == ["µm", alone[1].unit.label]


def test_noise_share_is_relative_to_the_records_variance(measured: StudyResults) -> None:
    from deabayes.figures.noise_share import correlated_shares, sizes

    results = measured.recommended
    name, shares = next(iter(correlated_shares(results).items()))
    observed = results.predictions[name]["observed"].values
    sigma = results.posterior[f"{results.noise_group(name)}.sigma_ou"].values
    assert shares["correlated"][1] == pytest.approx(np.median(sigma**2) / observed.var())
    size = sizes(results)[name]["correlated"]
    assert size == pytest.approx(np.median(sigma) / np.ptp(observed), rel=1e-3)


def test_noise_of_ratios_is_relative_to_the_variance_of_the_logarithm(
    measured: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deabayes.figures.noise_share import correlated_shares

    results = measured.recommended
    name = next(iter(correlated_shares(results)))
    sigma = results.posterior[f"{results.noise_group(name)}.sigma_ou"].values
    gain = 1e-6 * (2.0 + np.sin(np.arange(results.predictions[name]["observed"].size)))
    shown = results.predictions[name].assign(observed=("coordinate", gain))
    monkeypatch.setitem(results.predictions, name, shown)
    monkeypatch.setitem(results.records, name, {**results.records[name], "proportional": True})
    found = correlated_shares(results)[name]["correlated"][1]
    assert found == pytest.approx(np.median(sigma**2) / np.log(gain).var())


def test_white_noise_is_that_of_the_averaged_record(
    measured: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deabayes.figures.noise_share import correlated_shares

    results = measured.recommended
    name, before = next(iter(correlated_shares(results).items()))
    record = results.study.experiments[name]
    averaged = replace(record, samples_averaged=np.full(record.response.size, 25.0))
    monkeypatch.setitem(results.study.experiments, name, averaged)
    after = correlated_shares(results)[name]
    assert after["white"] == pytest.approx(before["white"] / 25.0)
    assert after["correlated"] == pytest.approx(before["correlated"])


@pytest.mark.parametrize("noise", NOISE_MODELS)
def test_shares_and_lengths_of_every_noise_model(tmp_path: Path, noise: str) -> None:
    from deabayes.figures.noise_share import correlated_shares

    fake = Fake(candidates=(1,), protocols=("relaxation",), noise=noise)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    (shares,) = correlated_shares(results).values()
    kinds = {"ar1": {"correlated"}, "white": {"white"}, "student_t": {"white"}}
    assert set(shares) == kinds.get(noise, {"correlated", "white"})
    assert all(np.all(np.isfinite(each)) and np.all(each > 0) for each in shares.values())
    (figure,) = figures.module("noise_share").draw(results)
    has_length = "correlation time or length" in texts(figure)
    assert has_length == ("correlated" in shares)


def test_noise_along_the_grid_lasts_for_points_and_not_seconds(
    tmp_path: Path,
) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",))
    results = StudyResults(write_study(tmp_path, fake)).recommended
    name = next(iter(results.predictions))
    results.attributes["study"]["noise_coordinate"] = "grid"
    (figure,) = figures.module("noise_share").draw(results)
    right = figure.axes[1]
    assert right.get_xlabel() == "points of the grid"
    lengths = [line.get_xdata()[0] for line in right.lines if line.get_marker() == "|"]
    assert lengths == [results.study.experiments[name].coordinate.size - 1]


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


@pytest.mark.parametrize("converged", [True, False])
def test_every_run_is_shown_against_the_limit(converged: bool, tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), converged=converged)
    study = write_study(tmp_path, fake)
    results = StudyResults(study).recommended
    ax = figures.draw("convergence", results)[0].axes[2]
    (points,) = ax.collections
    lengths, rows = np.asarray(points.get_offsets()).T
    np.testing.assert_array_equal(lengths, results.convergence["autocorrelation_times"])
    assert [ax.get_yticklabels()[int(k)].get_text() for k in rows] == [
        f"run {k}" for k in (1, 2, 3, 4)
    ]
    assert min(lengths) < 10.0, "one run alone may be short"
    colours = {to_hex(each) for each in points.get_facecolors()}
    assert colours == {(style.BLUE if converged else style.VERMILLION).lower()}
    assert list(ax.lines[0].get_xdata()) == [10.0, 10.0]
    low, high = ax.get_xlim()
    assert low < min(lengths) and high > max(lengths)
