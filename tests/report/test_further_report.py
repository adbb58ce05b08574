"""What the report and the figure say of further experiments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures.results import StudyResults
from deabayes.report import build, sections

NAN = float("nan")


def entry(name, nats, right, failed=0.0, held_out=False, extrapolation="", error=0.01):
    return {
        "experiment": name, "what": f"step {name}", "held_out": held_out,
        "candidates": "kv_gm_1, kv_gm_2", "information_candidate_nats": nats,
        "information_candidate_error_nats": error, "probability_right": right,
        "probability_right_error": 0.01, "failed_share": failed,
        "failure": "kv_gm_1: 9 × pull-in" if failed else "", "extrapolation": extrapolation,
        "information_kv_gm_1_nats": NAN if failed == 1.0 else 2.0,
        "information_kv_gm_1_error_nats": 0.1, "information_kv_gm_2_nats": 3.0,
        "information_kv_gm_2_error_nats": 0.1,
    }  # fmt: skip


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))


def said(study: Path, *entries: dict) -> str:
    pd.DataFrame(entries).to_csv(study / "further_experiments.csv", index=False)
    return sections.further_sentence(StudyResults(study))


def test_the_best_experiment_is_named_with_its_probability(study: Path) -> None:
    text = said(study, entry("3 kV", 0.6, 0.93, extrapolation="voltage is higher"),
                entry("2 kV", 0.5, 0.91))  # fmt: skip
    assert text.startswith("3 kV (step 3 kV) would be expected to tell kv_gm_1 from kv_gm_2")
    assert "probability 0.93" in text and "extrapolation (voltage is higher)" in text


def test_an_experiment_that_may_destroy_the_specimen_is_not_proposed(study: Path) -> None:
    text = said(study, entry("5 kV", 0.69, 1.0, failed=0.4), entry("2 kV", 0.5, 0.91))
    assert text.startswith("2 kV")
    text = said(study, entry("5 kV", 0.69, 1.0, failed=0.4), entry("2 kV", 0.01, 0.52))
    assert text.startswith("None of the 2 experiments") and "may not survive" in text


def test_of_equals_the_one_already_measured_or_in_range_is_proposed(study: Path) -> None:
    far = entry("5 kV", 0.692, 1.0, extrapolation="voltage is higher")
    near, measured = entry("3 kV", 0.690, 1.0), entry("sine", 0.680, 0.99, held_out=True)
    assert said(study, far, near).startswith("3 kV")
    text = said(study, far, near, measured)
    assert text.startswith("The held-out record sine")
    assert said(study, far, near | {"information_candidate_nats": 0.6}).startswith("5 kV")


def test_where_nothing_is_sure_or_nothing_tells(study: Path) -> None:
    text = said(study, entry("sine", 0.2, 0.75, held_out=True))
    assert text.startswith("The only experiment considered would not surely tell")
    assert "the held-out record sine" in text and "0.75 (0.50 is guessing)" in text
    text = said(study, entry("sine", 0.019, 0.55))
    assert text == (
        "The only experiment considered would not be expected to tell kv_gm_1 from kv_gm_2."
    )


def test_one_candidate_has_nobody_to_be_told_from(study: Path) -> None:
    alone = entry("3 kV", NAN, NAN) | {"candidates": "kv_gm_1"}
    assert said(study, alone) == ""
    (figure,) = figures.draw("further_experiments", StudyResults(study))
    assert len(figure.axes) == 1


def test_page_and_figure(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said(study, entry("3 kV", 0.6, 0.93), entry("5 kV", 0.5, 0.9, failed=1.0), )  # fmt: skip
    table = pd.read_csv(study / "comparison.csv")
    table["log_evidence_nested"] = np.where(table["candidate"] == "kv_gm_1", 12.3, NAN)
    table["log_evidence_nested_error"] = 0.2
    table.loc[0, "verdict"] = "chosen: x; bridge and nested sampling differ by -3.0"
    table.to_csv(study / "comparison.csv", index=False)
    name = "further_experiments"
    monkeypatch.setattr(figures, "REGISTRY", {name: figures.REGISTRY[name]})
    page = build([study], study.parent / "index.html", study.parent / "tables").read_text()
    assert "3 kV (step 3 kV) would be expected to tell kv_gm_1 from kv_gm_2" in page
    assert "100 % of the draws have no response" in page
    assert "12.3 ± 0.2" in page and "by nested" in page and "Evidence uncertain" in page
    assert (study.parent / "tables" / f"{study.name}_{name}.csv").is_file()
    (figure,) = figures.draw(name, StudyResults(study))
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["3 kV", "5 kV ▲"]


def test_without_the_table_nothing_is_said(study: Path) -> None:
    assert sections.further_sentence(StudyResults(study)) == ""
    assert sections.further_rows(StudyResults(study)) == []
    assert figures.draw("further_experiments", StudyResults(study)) == []
    pd.DataFrame(columns=["experiment", "candidates"]).to_csv(
        study / "further_experiments.csv", index=False
    )
    assert figures.draw("further_experiments", StudyResults(study)) == []
