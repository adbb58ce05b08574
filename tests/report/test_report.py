"""The report: one page without outside references, with warnings first and tables in full."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.faults import UserError
from deabayes.figures import style
from deabayes.figures.results import PopulationResults, StudyResults
from deabayes.report import build
from deabayes.report.contents import figure_folders
from deabayes.report.images import QUALITIES, embed, shrink
from deabayes.report.tables import parameters


def test_page_refers_to_nothing_outside_itself(built: tuple[str, Path]) -> None:
    page = built[0]
    sources = re.findall(r'src="([^"]{0,40})', page)
    assert sources
    assert all(s.startswith("data:image/webp;base64,") for s in sources)
    for outside in ("@import", "url(", "<link", "<script src"):
        assert outside not in page
    assert len(page) < 15e6


def test_page_links_to_files_beside_it(built: tuple[str, Path]) -> None:
    page, tables = built
    targets = set(re.findall(r'href="([^"#]+)"', page))
    assert all((tables.parent / target).is_file() for target in targets)
    assert {
        "../fake_strip/figures/kv_gm_2_data_and_bands.svg",
        "tables/fake_strip_kv_gm_1_predictions.csv",
        "tables/fake_strip_kv_gm_2_predictions.csv",
        "tables/fake_tube_summary.csv",
    } <= targets


def test_page_names_the_folders_of_its_figures_and_tables(built: tuple[str, Path]) -> None:
    page, tables = built
    assert f"tables lie in <code>{tables}/</code>" in page
    assert f"in <code>{tables.parents[1]}/&lt;study&gt;/figures/</code>." in page


def test_a_sheet_links_to_its_files_from_the_page(tmp_path: Path) -> None:
    folder = tmp_path / "a b" / "figures"
    folder.mkdir(parents=True)
    for ending in ("svg", "pdf"):
        (folder / f"errors.{ending}").touch()
    picture().save(folder / "errors.png")
    saved = SimpleNamespace(
        title="Errors", candidate="", svg=folder / "errors.svg", png=folder / "errors.png"
    )
    links = embed(saved, tmp_path / "report" / "index.html", 800, 32).links
    assert links == tuple(
        (ending.upper(), f"../a%20b/figures/errors.{ending}") for ending in ("svg", "pdf", "png")
    )
    (folder / "errors.pdf").unlink()
    links = embed(saved, tmp_path / "index.html", 800, 32).links
    assert [kind for kind, _ in links] == ["SVG", "PNG"]


def test_folders_of_figures_once_each() -> None:
    folders = ("r/a", "r/b", "s/c")
    studies = [StudyResults(Path(folder)) for folder in folders]
    new = [PopulationResults(Path("r/populations/p"))]
    assert figure_folders(studies, new) == [
        "r/<study>/figures", "s/<study>/figures", "r/populations/<population>/figures"
    ]  # fmt: skip
    (here,) = figure_folders([StudyResults(Path())], [])
    assert here == f"{Path.cwd().parent}/<study>/figures"


def test_two_results_folders_of_one_name_are_refused(
    built: tuple[str, Path], tmp_path: Path
) -> None:
    """Here a link to the study."""
    study = built[1].parents[1] / "fake_tube"
    (tmp_path / "fake_tube").mkdir()
    for path in study.iterdir():
        (tmp_path / "fake_tube" / path.name).symlink_to(path)
    words = f"{study} and {tmp_path / 'fake_tube'}: both are called 'fake_tube'"
    with pytest.raises(UserError, match=words):
        build([study, tmp_path / "fake_tube"], tmp_path / "index.html", tmp_path / "tables")
    assert not (tmp_path / "tables").exists()


def test_anchors_of_the_contents_exist(built: tuple[str, Path]) -> None:
    targets = set(re.findall(r'href="#([^"]+)"', built[0]))
    assert {"fake_strip", "fake_tube", "glossary"} <= targets
    assert all(f'id="{target}"' in built[0] for target in targets)
    assert "<dt>R-hat</dt>" in built[0] and "<dt>Shrinkage</dt>" not in built[0]


def test_verdicts_come_first_then_what_not_to_trust(built: tuple[str, Path]) -> None:
    text = re.sub(r'src="[^"]*"', "", built[0])
    parts = ("Use kv_gm_2", "No candidate converged", "Left out", "Of 2 candidates, use kv_gm_2",
             "mu_alpha: R-hat 1.310 is not below 1.01", "Words used</h2>")  # fmt: skip
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    strip = text[text.index('<section id="fake_strip"') : text.index('<section id="fake_tube"')]
    headings = ("What not to trust", "Parameters", "Errors", "Predictions of kv_gm_2", "Records")
    places = [strip.index(f">{heading}</h3>") for heading in headings]
    assert places == sorted(places)
    tube = text[text.index('<section id="fake_tube"') :]
    for part, words in ((strip, "Set by the prior, not by the data"), (tube, "Extrapolation"),
                        (tube, "Correlated noise replaces"), (tube, "3 gaps in the")):  # fmt: skip
        assert part.index(">What not to trust<") < part.index(words) < part.index(">Parameters<")
    assert "set DEABAYES_DATA &lt;folder&gt;" in text


def test_simulated_and_unconverged_are_tagged_at_tables(built: tuple[str, Path]) -> None:
    for caption in re.findall(r"<caption>(.*?)</caption>", built[0], re.DOTALL):
        tube = "simulated data" in caption
        assert tube == ("NOT CONVERGED" in caption)
    captions = re.findall(r"<caption>(.*?)</caption>", built[0], re.DOTALL)
    assert sum("simulated data" in c for c in captions) == 3


def test_other_candidates_are_folded_away(built: tuple[str, Path]) -> None:
    assert '<details class="figure"><summary>kv_gm_1' in built[0]
    assert '<details class="figure"><summary>kv_gm_2' not in built[0]


def test_tables_hold_all_candidates_at_full_precision(built: tuple[str, Path]) -> None:
    summary = pd.read_csv(built[1] / "fake_strip_summary.csv")
    assert set(summary["candidate"]) == {"kv_gm_1", "kv_gm_2"}
    assert set(summary["provenance"]) == {"measured"}
    errors = pd.read_csv(built[1] / "fake_tube_errors.csv")
    assert {"e_rms_percent", "extrapolation"} <= set(errors.columns)
    assert set(errors["provenance"]) == {"simulated"}
    assert (built[1] / "fake_strip_comparison.csv").is_file()
    points = pd.read_csv(built[1] / "fake_strip_kv_gm_1_predictions.csv").set_index("experiment")
    predictions = StudyResults(built[1].parents[1] / "fake_strip").candidates[0].predictions
    assert set(points.index) == set(predictions)
    for name, prediction in predictions.items():
        upper = prediction["predictive"].sel(level=0.9, bound="upper").values
        np.testing.assert_allclose(points.loc[name, "predictive_90_upper"], upper, rtol=1e-6)
        np.testing.assert_allclose(points.loc[name, "observed"], prediction["observed"], rtol=1e-6)


def test_parameter_rows_have_display_units_and_say_what_decided_them(
    built: tuple[str, Path],
) -> None:
    results = StudyResults(built[1].parents[1] / "fake_strip").recommended
    table = results.summary
    assert table is not None
    moved = {
        "mu_alpha": (0.234, 0.412),
        "tau_beta_1": (0.12, 0.01),
        "mu_beta_1": (np.nan, np.nan),
        "relaxation.tau_ou": (0.01, np.nan),
        "relaxation.sigma_ou": (0.2, np.nan),
    }
    columns = ["prior_sensitivity", "likelihood_sensitivity"]
    for name, sensitivities in moved.items():
        table.loc[name, columns] = sensitivities
    rows = {row["name"]: row for rows in parameters(results).values() for row in rows}
    assert rows["mu_alpha"]["unit"] == "kPa"
    assert rows["mu_alpha"]["value"].startswith(("34.9", "35.0"))
    assert rows["mu_alpha"]["symbol"] == "μ<sub>α</sub>"
    assert (
        rows["mu_alpha"]["prior"].startswith("4") and rows["mu_alpha"]["prior_law"] == "log-normal"
    )
    shown = {name: (row["sensitivities"], row["decided_by"]) for name, row in rows.items()}
    assert shown["mu_alpha"] == ("0.234 / 0.412", "moved by prior and data")
    assert shown["tau_beta_1"] == ("0.120 / 0.010", "moved by the prior")
    assert shown["mu_beta_1"] == ("not known", "")
    assert shown["relaxation.tau_ou"] == ("0.010 / not known", "")
    assert shown["relaxation.sigma_ou"] == ("0.200 / not known", "")
    assert shown["zeta_alpha"][1] == "set by the prior"
    assert shown["mu_total"][1] == ""


def test_results_from_before_sensitivities_are_reported(built: tuple[str, Path]) -> None:
    results = StudyResults(built[1].parents[1] / "fake_strip").recommended
    table = results.summary
    assert table is not None
    del table["prior_sensitivity"], table["likelihood_sensitivity"]
    rows = {row["name"]: row for rows in parameters(results).values() for row in rows}
    assert rows["mu_alpha"]["sensitivities"] == "–"
    assert rows["zeta_alpha"]["decided_by"] == "set by the prior"
    assert figures.draw("identifiability", results)


def test_words_stand_in_the_parameter_table(built: tuple[str, Path]) -> None:
    table = built[0][built[0].index("Parameters of kv_gm_2") :]
    assert '<br><span class="tag warn">set by the prior</span>' in table
    assert "Moved by<br>prior / data" in table


def entry(name: str, failed: float, **changes: object) -> dict[str, object]:
    return {
        "experiment": name, "what": f"step {name}", "held_out": False,
        "candidates": "kv_gm_1, kv_gm_2", "information_candidate_nats": 0.6,
        "information_candidate_error_nats": 0.01, "probability_right": 0.93,
        "probability_right_error": 0.01, "failed_share": failed,
        "failure": "kv_gm_1: 9 × pull-in" if failed else "", "extrapolation": "",
        "information_kv_gm_1_nats": 2.0, "information_kv_gm_1_error_nats": 0.1,
        "information_kv_gm_2_nats": 3.0, "information_kv_gm_2_error_nats": 0.1,
    } | changes  # fmt: skip


def test_further_experiments_and_nested_evidence_are_on_the_page_and_in_the_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "further_experiments"
    monkeypatch.setattr(figures, "REGISTRY", {name: figures.REGISTRY[name]})
    study = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    assert figures.draw(name, StudyResults(study)) == []
    rows = [entry("3 kV", 0.0), entry("5 kV", 1.0, information_candidate_nats=0.5)]
    pd.DataFrame(rows).to_csv(study / f"{name}.csv", index=False)
    table = pd.read_csv(study / "comparison.csv")
    table["log_evidence_nested"] = np.where(table["candidate"] == "kv_gm_1", 12.3, np.nan)
    table["log_evidence_nested_error"] = 0.2
    table.loc[0, "verdict"] = "chosen: x; bridge and nested sampling differ by -3.0"
    table.to_csv(study / "comparison.csv", index=False)
    page = build([study], tmp_path / "index.html", tmp_path / "tables").read_text()
    assert "3 kV (step 3 kV) would be expected to tell kv_gm_1 from kv_gm_2" in page
    assert "100 % of the draws have no response" in page
    assert "12.3 ± 0.2" in page and "by nested" in page and "Evidence uncertain" in page
    assert (tmp_path / "tables" / f"{study.name}_{name}.csv").is_file()
    (figure,) = figures.draw(name, StudyResults(study))
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["3 kV", "5 kV ▲"]
    pd.DataFrame([entry("3 kV", 0.0, candidates="kv_gm_1")]).to_csv(study / f"{name}.csv")
    (figure,) = figures.draw(name, StudyResults(study))
    assert len(figure.axes) == 1
    pd.DataFrame(columns=["experiment", "candidates"]).to_csv(study / f"{name}.csv", index=False)
    assert figures.draw(name, StudyResults(study)) == []


def picture() -> Image.Image:
    """Patches of all colours a legend may have, and lines that blend them with white."""
    colours = [*style.SERIES, *(colour for colour, _ in style.BANDS.values()), "#a6d3ee"]
    canvas = np.full((700, 2161, 3), 255.0)
    for k, colour in enumerate(colours):
        value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        canvas[20:60, 20 + 110 * k : 110 + 110 * k] = value
        shares = np.linspace(0.0, 1.0, 200)[:, None]
        canvas[100 + 40 * k : 102 + 40 * k, 20:220] = shares * value + (1.0 - shares) * 255.0
    return Image.fromarray(canvas.round().astype(np.uint8))


@pytest.mark.parametrize(("width", "colours"), QUALITIES)
def test_embedded_figures_keep_the_colours_of_areas(
    tmp_path: Path, width: int, colours: int
) -> None:
    original = picture()
    original.save(path := tmp_path / "figure.png")
    data, size = shrink(path, width, colours)
    assert size == original.size and len(data) < 20_000
    (small := tmp_path / "small.webp").write_bytes(data)
    with Image.open(small) as opened:
        found = np.asarray(opened.convert("RGB")).astype(int)
        assert len(opened.convert("RGB").getcolors()) <= colours
    assert tuple(found[5, 5]) == (255, 255, 255)
    factor = found.shape[1] / original.size[0]
    for k in range(12):
        x, y = 65 + 110 * k, 40
        shown, meant = found[round(factor * y), round(factor * x)], original.getpixel((x, y))
        assert np.abs(shown - np.array(meant)).max() <= 6, (k, shown, meant)


def test_a_dot_keeps_its_colour_among_its_blends(tmp_path: Path) -> None:
    """Blurred edges of text and lines have all colours between white and full ones."""
    rng, colours = np.random.default_rng(1), np.array([[0xD5, 0x5E, 0], [0, 0x72, 0xB2], [0, 0, 0]])
    full, share = colours[rng.integers(0, 3, (50, 270))], rng.uniform(0.0, 0.9, (50, 270, 1))
    canvas = np.full((600, 2160, 3), 255.0)
    canvas[:400] = (255 + share * (full - 255.0)).repeat(8, axis=0).repeat(8, axis=1)
    canvas[500:512, 40:52] = colours[0]
    Image.fromarray(canvas.astype(np.uint8)).save(path := tmp_path / "figure.png")
    (small := tmp_path / "small.webp").write_bytes(shrink(path, 1000, 64)[0])
    with Image.open(small) as opened:
        assert opened.convert("RGB").getpixel((21, 234)) == tuple(colours[0])
