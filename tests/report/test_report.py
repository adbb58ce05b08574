"""The report: one page without outside references, warnings first, honest tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.faults import UserError
from deabayes.figures.results import PopulationResults, StudyResults
from deabayes.report import build, notices
from deabayes.report.page import figure_folders, verdict
from deabayes.report.tables import about, errors, parameters

UNCONVERGED = Fake(
    name="fake_tube",
    provenance="simulated",
    converged=False,
    candidates=(1,),
    protocols=("creep", "sine", "sine"),
    extrapolation="voltage 0 to 3500 V lies outside the calibrated 0 to 2500 V",
    correlated_noise=8e3,
    warnings=("3 gaps in the sampling",),
)
LEFT_OUT = "silicones: the records are not here; set DEABAYES_DATA <folder>"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("results")
    protocols = ("relaxation", "load_unload")
    studies = [
        write_study(folder, Fake(candidates=(1, 2), protocols=protocols)),
        write_study(folder, UNCONVERGED),
    ]
    output = folder / "report" / "index.html"
    few = {name: figures.REGISTRY[name] for name in ("data_and_bands", "coverage", "errors")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "REGISTRY", few)
        assert build(studies, output, folder / "report" / "tables", [LEFT_OUT]) == output
    return output.read_text(encoding="utf-8"), folder / "report" / "tables"


def test_page_refers_to_nothing_outside_itself(built: tuple[str, Path]) -> None:
    page = built[0]
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert sources
    assert all(s.startswith(("data:image/png;base64,", "#")) for s in sources)
    for outside in ("@import", "url(", "<script"):
        assert outside not in page
    assert len(page) < 15e6


def test_page_names_the_folders_of_its_figures_and_tables(built: tuple[str, Path]) -> None:
    page, tables = built
    assert f"tables lie in <code>{tables}/</code>" in page
    assert f"in <code>{tables.parents[1]}/&lt;study&gt;/figures/</code>." in page


def test_folders_of_figures_once_each() -> None:
    folders = ("r/a", "r/b", "s/c")
    studies = [StudyResults(Path(folder)) for folder in folders]
    new = [PopulationResults(Path("r/populations/p"))]
    assert figure_folders(studies, new) == [
        "r/<study>/figures", "s/<study>/figures", "r/populations/<population>/figures"
    ]  # fmt: skip
    (here,) = figure_folders([StudyResults(Path())], [])
    assert here == f"{Path.cwd().parent}/<study>/figures"


def test_two_results_folders_of_one_name_are_refused(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_study(tmp_path / name, UNCONVERGED)
    folders = [tmp_path / name / "fake_tube" for name in ("one", "two")]
    with pytest.raises(UserError, match=f"{folders[0]} and {folders[1]}: both are called 'fake_"):
        build(folders, tmp_path / "index.html", tmp_path / "tables")
    assert not (tmp_path / "tables").exists()


def test_anchors_of_the_contents_exist(built: tuple[str, Path]) -> None:
    targets = set(re.findall(r'href="#([^"]+)"', built[0]))
    assert {"fake_strip", "fake_tube", "glossary"} <= targets
    assert all(f'id="{target}"' in built[0] for target in targets)


def test_warnings_come_before_results(built: tuple[str, Path]) -> None:
    text = re.sub(r'src="[^"]*"', "", built[0])
    place = text.index("Read this first")
    assert place < text.index("Left out") < text.index("Contents") < text.index("What was fitted")
    for words in (
        "mu_alpha: R-hat 1.310 is not below 1.01",
        "Extrapolation",
        "The noise model takes what the physics lacks",
        "Set by the prior",
    ):
        assert place < text.index(words) < text.index("Contents")
    assert "set DEABAYES_DATA &lt;folder&gt;" in text
    assert "3 gaps in the sampling" in text[: text.index("Contents")]


def test_simulated_and_unconverged_are_tagged_at_tables(built: tuple[str, Path]) -> None:
    for caption in re.findall(r"<caption>(.*?)</caption>", built[0], re.DOTALL):
        tube = "simulated data" in caption
        assert tube == ("NOT CONVERGED" in caption)
    captions = re.findall(r"<caption>(.*?)</caption>", built[0], re.DOTALL)
    assert sum("simulated data" in c for c in captions) == 3


def test_other_candidates_are_folded_away(built: tuple[str, Path]) -> None:
    assert "<details><summary>kv_gm_1" in built[0]
    assert "<details><summary>kv_gm_2" not in built[0]


def test_tables_hold_all_candidates_at_full_precision(built: tuple[str, Path]) -> None:
    summary = pd.read_csv(built[1] / "fake_strip_summary.csv")
    assert set(summary["candidate"]) == {"kv_gm_1", "kv_gm_2"}
    assert set(summary["provenance"]) == {"measured"}
    errors = pd.read_csv(built[1] / "fake_tube_errors.csv")
    assert {"e_rms_percent", "extrapolation"} <= set(errors.columns)
    assert set(errors["provenance"]) == {"simulated"}
    assert (built[1] / "fake_strip_comparison.csv").is_file()


def test_parameter_rows_are_in_display_units(tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",))
    results = StudyResults(write_study(tmp_path, fake)).recommended
    rows = {row["name"]: row for rows in parameters(results).values() for row in rows}
    assert rows["mu_alpha"]["unit"] == "kPa"
    assert rows["mu_alpha"]["value"].startswith(("34.9", "35.0"))
    assert rows["mu_alpha"]["symbol"] == "μ<sub>α</sub>"
    assert rows["mu_alpha"]["decided_by"] == ""


def test_parameters_say_who_decided_them(tmp_path: Path) -> None:
    moved = {
        "mu_alpha": (0.234, 0.412),
        "tau_beta_1": (0.12, 0.01),
        "mu_beta_1": (np.nan, np.nan),
        "relaxation.tau_ou": (0.01, np.nan),
        "relaxation.sigma_ou": (0.2, np.nan),
    }
    fake = Fake(candidates=(1,), protocols=("relaxation",), sensitivities=moved)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    rows = {row["name"]: row for rows in parameters(results).values() for row in rows}
    shown = {name: (row["sensitivities"], row["decided_by"]) for name, row in rows.items()}
    assert shown["mu_alpha"] == ("0.234 / 0.412", "moved by prior and data")
    assert shown["tau_beta_1"] == ("0.120 / 0.010", "moved by the prior")
    assert shown["mu_beta_1"] == ("not known", "")
    assert shown["relaxation.tau_ou"] == ("0.010 / not known", "")
    assert shown["relaxation.sigma_ou"] == ("0.200 / not known", "")
    assert shown["zeta_alpha"][1] == "set by the prior"
    assert shown["mu_total"][1] == ""
    found = {n.title: n for n in notices.of_candidate(results)}
    assert found["Moved by prior and data"].details[0].startswith("mu_alpha: ")
    assert not found["Moved by prior and data"].serious
    assert found["Moved by the prior"].details[0].startswith("tau_beta_1: ")
    assert not found["Moved by the prior"].serious
    assert found["Set by the prior, not by the data"].details[0].startswith("zeta_alpha: ")


def test_a_posterior_as_wide_as_its_prior_that_data_move_is_not_set_by_it(tmp_path: Path) -> None:
    fake = Fake(
        candidates=(1,), protocols=("relaxation",), sensitivities={"zeta_alpha": (0.3, 0.3)}
    )
    results = StudyResults(write_study(tmp_path, fake)).recommended
    assert results.summary is not None
    assert results.summary.loc["zeta_alpha", "contraction"] < 0.1
    titles = {n.title for n in notices.of_candidate(results)}
    assert "Moved by prior and data" in titles
    assert "Set by the prior, not by the data" not in titles


def test_results_from_before_sensitivities_are_reported(tmp_path: Path) -> None:
    folder = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    path = folder / "kv_gm_2" / "summary.csv"
    old = pd.read_csv(path).drop(columns=["prior_sensitivity", "likelihood_sensitivity"])
    old.to_csv(path, index=False)
    few = {"identifiability": figures.REGISTRY["identifiability"]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "REGISTRY", few)
        page = build([folder], tmp_path / "index.html", tmp_path / "tables", [])
    results = StudyResults(folder).candidates[1]
    rows = {row["name"]: row for rows in parameters(results).values() for row in rows}
    assert rows["mu_alpha"]["sensitivities"] == "–"
    assert rows["zeta_alpha"]["decided_by"] == "set by the prior"
    assert "What the data determined" in page.read_text(encoding="utf-8")


def test_words_stand_in_the_parameter_table(built: tuple[str, Path]) -> None:
    table = built[0][built[0].index("Parameters of kv_gm_2") :]
    assert '<br><span class="tag warn">set by the prior</span>' in table
    assert "Moved by<br>prior / data" in table


def test_verdicts(tmp_path: Path) -> None:
    protocols = ("relaxation",)
    unresolved = "not resolved by these data against kv_gm_1; the smallest order"
    cases = {
        "chosen": (Fake(name="chosen", candidates=(1, 2), protocols=protocols), "use kv_gm_2"),
        "open": (
            Fake(name="open", candidates=(1, 2), protocols=protocols, verdict=unresolved),
            "do not settle",
        ),
        "bad": (Fake(name="bad", converged=False, protocols=protocols), "none is to be used"),
        "single": (Fake(name="single", candidates=(1,), protocols=protocols), "no order to choose"),
    }
    for fake, words in cases.values():
        assert words in verdict(StudyResults(write_study(tmp_path, fake)))


def test_the_only_converged_candidate_is_not_recommended(tmp_path: Path) -> None:
    folder = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    table = pd.read_csv(folder / "comparison.csv")
    table["verdict"] = ["nothing to compare: the only candidate that converged", "not ranked"]
    table.to_csv(folder / "comparison.csv", index=False)
    found = verdict(StudyResults(folder))
    assert found.startswith("Only kv_gm_1 of 2 candidates converged")
    assert "not recommended" in found


def test_candidates_that_were_not_compared_are_not_called_one(tmp_path: Path) -> None:
    study = write_study(tmp_path)
    (study / "comparison.csv").unlink()
    assert verdict(StudyResults(study)).startswith("3 candidates were fitted and not compared")


def test_a_score_that_is_not_known_is_left_empty(tmp_path: Path) -> None:
    folder = write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",)))
    (table,) = folder.glob("*/errors.csv")
    scores = ["coverage_50", "coverage_90", "crps"]
    empty = dict.fromkeys([*scores, "pit_p"], np.nan)
    pd.read_csv(table).assign(**empty).to_csv(table, index=False)
    (row,) = errors(StudyResults(folder).recommended)["calibration"]
    assert [row[score] for score in [*scores, "pit"]] == ["", "", "", ""]
    pd.read_csv(table).drop(columns="pit_p").to_csv(table, index=False)
    (row,) = errors(StudyResults(folder).recommended)["calibration"]
    assert row["pit"] == ""


def test_what_a_record_states_is_read_with_its_unit() -> None:
    stated: dict[str, float | str] = {
        "note": "second pull", "load_g": 300.0, "bias_kV": 2.0, "stretch_rate_per_s": 0.05,
        "crosshead_mm_per_min": 500.0, "deformation": "uniaxial", "batch_s": "B", "stretch": 2.0,
        "amplitude_kV": np.nan,
    }  # fmt: skip
    assert about(stated) == (
        "load 300 g; bias 2 kV; stretch rate 0.05 1/s; crosshead 500 mm/min; "
        "deformation uniaxial; batch s B; stretch 2; second pull"
    )
