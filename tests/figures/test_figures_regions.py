"""What bands, regions, intervals and colours stand for is what they are drawn as."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from tests.shared import fake_records
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures import bands, residuals, style
from deabayes.figures.record import Record
from deabayes.figures.results import StudyResults
from deabayes.papers import hysteresis
from deabayes.papers.minimum_energy_structure import structure_errors, structure_loops
from deabayes.papers.tubular import frequency_response

PHASE = np.linspace(0.0, 2.0 * np.pi, 81)


def loop(volts: float = 5e3, hertz: float = 1.0, width: float = 3.0) -> xr.Dataset:
    """A loop of one candidate and cycle whose bands, `width` mm wide, overlap."""
    middle = 1e-3 * (5.0 - 4.0 * np.cos(PHASE) + np.sin(PHASE))
    bands = np.stack([middle - 0.5e-3 * width, middle, middle + 0.5e-3 * width])
    return xr.Dataset(
        {
            "voltage": (("cycle", "phase"), 0.5 * volts * (1.0 - np.cos(PHASE))[None]),
            "measured": (("cycle", "phase"), middle[None]),
            "predicted": (("candidate", "bound", "cycle", "phase"), bands[None, :, None]),
        },
        {"candidate": ["kv_gm_1"], "converged": ("candidate", [True]), "cycle": [1]},
        {"amplitude_kV": volts / 1e3, "frequency_Hz": hertz},
    )


def of_structure(*records: xr.Dataset) -> Figure:
    found = SimpleNamespace(curves=dict(enumerate(records)))
    best = SimpleNamespace(name="kv_gm_1")
    results = SimpleNamespace(recommended=best)
    (figure,) = structure_loops.draw(results, found)  # type: ignore[arg-type]
    return figure


def of_cycles(record: xr.Dataset) -> Figure:
    figure = Figure()
    hysteresis._loops(figure.subplots(), record, 0)
    return figure


@pytest.mark.parametrize("draw", [of_cycles, of_structure])
def test_bands_of_loops_are_filled_where_their_branches_overlap(draw: object) -> None:
    record = loop()
    ax = draw(record).axes[-1]  # type: ignore[operator]
    volts = record["voltage"].values[0, 1:-1] / 1e3
    lower, _, upper = 1e3 * record["predicted"].values[0, :, 0, 1:-1]
    outlines = [path for each in ax.collections for path in each.get_paths()]
    outlines += [each.get_path() for each in ax.patches]
    for share in (0.1, 0.35, 0.6, 0.9):
        points = np.column_stack([volts, lower + share * (upper - lower)])
        inside = np.any([path.contains_points(points) for path in outlines], axis=0)
        assert inside.all(), f"{(~inside).sum()} of {inside.size} empty"


def test_residuals_of_a_sine_are_those_of_the_whole_record(tmp_path: Path) -> None:
    results = StudyResults(write_study(tmp_path, Fake(candidates=(1,), protocols=("sine",))))
    (prediction,) = results.recommended.predictions.values()
    record = Record(prediction)
    assert record.shown.start > 0
    early = prediction["observed"].values.copy()
    early[: record.shown.start] += np.ptp(early)
    record = Record(prediction.assign(observed=("coordinate", early)))
    figure = residuals._spread(SimpleNamespace(noise_group=lambda name: "sine"), [record])
    reach = np.concatenate([line.get_xdata() for line in figure.axes[0].lines])
    share = 100 * (early - prediction["median"].values) / np.ptp(early)
    assert reach.max() == pytest.approx(np.quantile(share, 0.95), rel=0.02)


def test_a_rate_has_one_colour_whatever_was_measured_at_other_voltages() -> None:
    figure = of_structure(loop(5e3, 10.0), loop(5e3, 5.0), loop(4e3, 5.0), loop(4e3, 1.0))
    legend = {handle.get_label(): to_hex(handle.get_color())
              for handle in figure.legends[0].get_lines()}  # fmt: skip
    drawn = [[to_hex(line.get_color()) for line in ax.lines[::2]] for ax in figure.axes[1::2]]
    assert drawn == [[legend["5 Hz"], legend["10 Hz"]], [legend["1 Hz"], legend["5 Hz"]]]


def response(name: str, kind: str) -> xr.Dataset:
    frequency = np.geomspace(1.0, 100.0, 20)
    bands = np.ones((1, 2, 20)) * np.array([0.9, 1.1])[None, :, None]
    return xr.Dataset(
        {
            "observed": ("coordinate", 1.0 + 0 * frequency),
            "median": ("coordinate", 1.0 + 0 * frequency),
            "excitation": ("coordinate", 1e3 + 0 * frequency),
            "predictive": (("level", "bound", "coordinate"), bands),
        },
        {"coordinate": frequency, "level": [0.9], "bound": ["lower", "upper"]},
        {
            "experiment": name, "response_name": kind, "role": "calibrate",
            "protocol": "frequency_response",
            "response_unit": "1" if kind == "gain" else "rad",
        },
    )  # fmt: skip


def of_responses(*predictions: xr.Dataset) -> Figure:
    experiments = {p.attrs["experiment"]: SimpleNamespace(metadata={}) for p in predictions}
    results = SimpleNamespace(
        predictions={p.attrs["experiment"]: p for p in predictions},
        study=SimpleNamespace(experiments=experiments),
    )
    (figure,) = frequency_response.draw(results)  # type: ignore[arg-type]
    return figure


def test_the_band_of_one_response_is_drawn_as_its_legend_says() -> None:
    figure = of_responses(response("a", "gain"), response("a_phase", "phase"))
    (patch,) = figure.legends[0].get_patches()
    for ax in figure.axes:
        assert tuple(ax.collections[0].get_facecolor()[0]) == patch.get_facecolor()
    figure = of_responses(response("a", "gain"), response("b", "gain"))
    (label,) = (t.get_text() for t in figure.legends[0].get_texts() if "band" in t.get_text())
    assert "its record's colour" in label


def test_gain_and_phase_of_a_record_share_a_colour() -> None:
    figure = of_responses(response("a", "gain"), response("b", "gain"),
                          response("b_phase", "phase"), response("c_phase", "phase"))  # fmt: skip
    legend = {handle.get_label().split(",")[0]: to_hex(handle.get_color())
              for handle in figure.legends[0].get_lines()}  # fmt: skip
    gain, phase = ([to_hex(line.get_color()) for line in ax.lines[::2]] for ax in figure.axes)
    assert len(set(legend.values())) == 3
    assert gain == [legend["a"], legend["b"]]
    assert phase == [legend["b"], legend["c_phase"]]


class OfTube(StudyResults):
    """Results that say they are of a tube."""

    system = "tubular"


def test_a_sine_beside_its_loop_is_named_and_flagged(tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("sine",) * 3, extrapolation="voltage is higher")
    results = OfTube(write_study(tmp_path, fake))
    from tests.figures.test_figures import texts

    names = {n: e.role for n, e in results.experiments.items()}
    for figure, (name, role) in zip(
        figures.draw("strain_voltage", results.recommended), names.items(), strict=True
    ):
        found = " ".join(texts(figure))
        assert name in found
        assert ("held out" if role == "validate" else "calibration") in found
        assert ("EXTRAPOLATION" in found) == (role == "validate")
        assert "from rest" in found and "last cycle" in found


def test_the_evidence_has_the_errors_of_both_candidates(tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    path = study / "comparison.csv"
    table = pd.read_csv(path).assign(log_evidence_mcse=[3.0, 4.0])
    table.to_csv(path, index=False)
    (figure,) = figures.draw("comparison", StudyResults(study))
    bars = [segment[:, 0] for each in figure.axes[0].collections
            if isinstance(each, LineCollection) for segment in each.get_segments()]  # fmt: skip
    assert [np.ptp(bar) for bar in bars] == pytest.approx([2 * 2 * 5.0])


@pytest.mark.parametrize("name", ["errors", "comparison"])
def test_long_names_fit_beside_and_below_the_panels(name: str, tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(candidates=(1, 2, 3, 4), protocols=("relaxation",)))
    table = pd.read_csv(study / "comparison.csv")
    table["log_evidence"] = [-2e5, -5e3, -2e3, -2e3]
    for k, short in enumerate(table["candidate"]):
        table.loc[k, "candidate"] = f"ogden_4_with_leakage_and_series_resistance_{short}"
        (study / short).rename(study / table.loc[k, "candidate"])
    table.to_csv(study / "comparison.csv", index=False)
    (figure,) = figures.draw(name, StudyResults(study))
    for legend in figure.legends:
        box = legend.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.width
    for ax in figure.axes:
        boxes = [t.get_window_extent() for t in ax.get_xticklabels() if t.get_text()]
        assert all(a.x1 < b.x0 for a, b in pairwise(sorted(boxes, key=lambda box: box.x0)))


def test_labels_of_preparation_stay_in_their_column(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The longest one: counted from the hold, linear first and logarithmic then."""
    monkeypatch.setattr(
        fake_records, "_drive", lambda _, time, amplitude: np.where(time < 0.5, 1.0, amplitude)
    )
    study = StudyResults(write_study(tmp_path, Fake(protocols=("relaxation",) * 3)))
    (figure,) = figures.draw("preparation", study)
    figure.draw_without_rendering()
    boxes = [
        ax.xaxis.label.get_window_extent()
        for ax in figure.findobj(Axes)
        if "logarithmic" in ax.get_xlabel()
    ]
    assert len(boxes) == 3
    assert all(a.x1 < b.x0 for a, b in pairwise(sorted(boxes, key=lambda box: box.x0)))
    assert min(box.x0 for box in boxes) >= 0


def test_intervals_of_errors_are_drawn_where_they_are(tmp_path: Path) -> None:
    """The median curve's error often lies below those of single draws."""
    study = write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",)))
    path = study / "kv_gm_1" / "errors.csv"
    table = pd.read_csv(path)
    table[["e_rms_percent", "e_rms_q05", "e_rms_q95"]] = [1.0, 2.0, 3.0]
    table.to_csv(path, index=False)
    (figure,) = figures.draw("errors", StudyResults(study))
    ends = [segment[:, 0].tolist() for each in figure.axes[0].collections
            if isinstance(each, LineCollection) for segment in each.get_segments()]  # fmt: skip
    assert ends == [[2.0, 3.0]]
    assert not any(isinstance(each, PathCollection) for each in figure.axes[0].collections)
    assert "single draws" in figures.module("errors").CAPTION


X = np.linspace(0.0, 1.0, 20)


def test_edges_of_the_predictive_band_lie_on_the_one_that_fills_it() -> None:
    ends = dict.fromkeys(style.BANDS, (-1.0 - 0 * X, 1.0 + X))
    ax = Figure().subplots()
    bands.fill(ax, X, ends)
    for line, edge in zip(ax.lines, ends["predictive"], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), edge)
        assert line.get_zorder() > max(each.get_zorder() for each in ax.collections)
        assert to_hex(line.get_color()) not in [colour for colour, _ in style.BANDS.values()]


def test_the_legend_shows_the_edge_of_the_predictive_band_alone() -> None:
    entries = {handle.get_label(): handle for handle in bands.handles()[2:]}
    for name, (colour, label) in style.BANDS.items():
        patch = entries[label]
        assert to_hex(patch.get_facecolor()) == to_hex(colour)
        outlined = to_hex(patch.get_edgecolor()) == style.GREY
        assert outlined == (name == "predictive")


FACTORS = [(15.0, "linear"), (100.0, "log")]


@pytest.mark.parametrize(("factor", "scale"), FACTORS)
def test_errors_of_two_candidates(factor: float, scale: str, tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(candidates=(1, 2)))
    for path, value in zip(sorted(study.glob("*/errors.csv")), (0.2, 0.2 * factor), strict=True):
        table = pd.read_csv(path)
        table[["e_rms_percent", "e_rms_q05", "e_rms_q95"]] = [value, 0.9 * value, 1.5 * value]
        table.to_csv(path, index=False)
    (figure,) = figures.draw("errors", StudyResults(study))
    for ax in figure.axes:
        assert ax.get_xscale() == scale
        low, high = ax.get_xlim()
        assert low < 0.18 and high > 0.3 * factor


@pytest.mark.parametrize(("factor", "scale"), FACTORS)
def test_errors_of_sines_of_a_structure(factor: float, scale: str) -> None:
    table = pd.DataFrame({"candidate": ["a", "b"], "converged": True, "frequency_Hz": 1.0})
    for voltage in ("4kV", "5kV"):
        table[f"role_{voltage}"] = "validate"
        for end, part in (("percent", 1.0), ("q05", 0.9), ("q95", 1.5)):
            table[f"e_rms_{voltage}_{end}"] = [0.2 * part, 0.2 * part * factor]
        table[f"paper_e_rms_{voltage}_percent"] = 0.2
    found = SimpleNamespace(tables={"table_5_errors": table})
    (figure,) = structure_errors.draw(None, found)  # type: ignore[arg-type]
    for ax in figure.axes:
        assert ax.get_yscale() == scale
        low, high = ax.get_ylim()
        assert low < 0.18 and high > 0.3 * factor
