"""The stage between predictions and figures: every registered analysis, and how it is kept."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.shared import structure_contexts
from tests.shared.contexts import computed, context
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures, papers
from deabayes.faults import UserError
from deabayes.figures.results import StudyResults
from deabayes.papers.base import Analysis
from deabayes.report.contents import Place, render
from deabayes.report.tables import readable, write_csv
from deabayes.systems import REGISTRY as SYSTEMS


def made_up(name="mean_modulus", systems=(), tables=("modulus",)):
    """An analysis module: the mean modulus of every candidate."""
    module = ModuleType(f"made_up_{name}")
    module.SYSTEMS, module.TITLE, module.CAPTION = systems, "Mean modulus", "Of the draws."

    def compute(context):
        rows = [
            {
                "candidate": name, "converged": fitted.converged,
                "mu_kPa": fitted.draws["mu_alpha"].mean() / 1e3, "mu_q05": 30.0, "mu_q95": 40.0,
            }
            for name, fitted in context.candidates.items()
        ]  # fmt: skip
        curve = xr.Dataset({"drawn": ("x", context.rng(name).standard_normal(3))})
        return Analysis(dict.fromkeys(tables, pd.DataFrame(rows)), {"noise": curve})

    module.compute = compute
    return module


@pytest.fixture
def registered(monkeypatch):
    """Only the made-up analysis is registered."""
    monkeypatch.setitem(sys.modules, "made_up", made_up())
    monkeypatch.setattr(papers, "REGISTRY", {"mean_modulus": "made_up"})


@pytest.mark.parametrize("name", papers.REGISTRY)
def test_every_analysis_says_what_it_is(name):
    module = papers.module(name)
    assert set(module.SYSTEMS) <= set(SYSTEMS)
    assert module.TITLE and module.CAPTION and callable(module.compute)
    assert module.__name__.startswith("deabayes.papers.")
    assert module.__name__.endswith(f".{name}")


def test_figures_draw_registered_analyses():
    named = {getattr(figures.module(name), "ANALYSIS", "") for name in figures.REGISTRY}
    assert named - {""} <= set(papers.REGISTRY)


def test_unknown_analysis(registered):
    with pytest.raises(UserError, match="did you mean 'mean_modulus'"):
        papers.module("mean_moduli")


def test_a_system_has_its_own_and_the_common_ones(monkeypatch):
    for name, systems in (("one", ("tubular",)), ("two", ())):
        monkeypatch.setitem(sys.modules, name, made_up(name, systems))
    monkeypatch.setattr(papers, "REGISTRY", {"one": "one", "two": "two"})
    assert papers.names_for("tubular") == ["one", "two"]
    assert papers.names_for("membrane") == ["two"]


def test_what_is_computed_is_read_back(registered, tmp_path):
    study = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    results = StudyResults(study)
    assert results.analysis("mean_modulus") is None
    assert papers.run_all(context(), study / "analyses") == ["mean_modulus"]
    found = StudyResults(study).analysis("mean_modulus")
    assert found is not None
    assert (found.title, found.caption) == ("Mean modulus", "Of the draws.")
    assert list(found.tables["modulus"]["candidate"]) == ["kv_gm_1", "kv_gm_2"]
    assert found.curves["noise"]["drawn"].size == 3
    assert study / "analyses" / "mean_modulus" / "modulus.csv" in StudyResults(study).inputs


def test_same_seed_same_draws_and_other_study_others(registered, tmp_path):
    def drawn(context, folder):
        papers.run_all(context, folder)
        return xr.load_dataset(folder / "mean_modulus" / "noise.nc")["drawn"].values

    first = drawn(context(), tmp_path / "a")
    np.testing.assert_array_equal(first, drawn(context(), tmp_path / "b"))
    other = context(study=replace(context().study, name="another"))
    assert np.all(first != drawn(other, tmp_path / "c"))


def test_what_was_there_before_goes(registered, tmp_path, monkeypatch):
    papers.run_all(context(), tmp_path / "analyses")
    monkeypatch.setattr(papers, "REGISTRY", {})
    papers.run_all(context(), tmp_path / "analyses")
    assert [path.name for path in tmp_path.rglob("*")] == ["analyses", "index.json"]


def test_a_failing_analysis_leaves_what_was_there(registered, tmp_path, monkeypatch):
    papers.run_all(context(), tmp_path / "analyses")
    before = sorted(path.read_bytes() for path in (tmp_path / "analyses").rglob("*.*"))
    monkeypatch.setitem(sys.modules, "broken", made_up("broken", tables=("modulus",)))
    monkeypatch.setattr(papers, "REGISTRY", {**papers.REGISTRY, "broken": "broken"})
    with pytest.raises(ValueError, match="broken: a table 'modulus' exists already"):
        papers.run_all(context(), tmp_path / "analyses")
    assert before == sorted(path.read_bytes() for path in (tmp_path / "analyses").rglob("*.*"))


def test_a_system_without_analyses_passes(monkeypatch, tmp_path):
    monkeypatch.setattr(papers, "REGISTRY", {})
    study = write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",)))
    assert papers.run_all(context(), study / "analyses") == []
    assert json.loads((study / "analyses" / "index.json").read_text()) == []
    assert StudyResults(study).analyses == ()
    page = render([StudyResults(study)], {study: []}, [], {}, Place(tmp_path, tmp_path))
    assert "What the paper reports" not in page


def test_an_analysis_with_nothing_to_show_has_no_heading(registered, tmp_path):
    study = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    papers.run_all(context(), study / "analyses")
    index = study / "analyses" / "index.json"
    (entry,) = json.loads(index.read_text())
    index.write_text(json.dumps([{**entry, "tables": [], "curves": []}]))
    page = render([StudyResults(study)], {study: []}, [], {}, Place(tmp_path, tmp_path))
    assert "Mean modulus" not in page and "Of the draws." not in page


def test_the_report_shows_tables_and_keeps_them_whole(registered, tmp_path):
    study = write_study(tmp_path, Fake(candidates=(1, 2), protocols=("relaxation",)))
    papers.run_all(context(), study / "analyses")
    results = StudyResults(study)
    page = render([results], {results.folder: []}, [], {}, Place(tmp_path, tmp_path))
    text = page[page.index("What the paper reports") :]
    assert (
        text.index("Mean modulus") < text.index("<th>candidate</th>") < text.index("Of the draws")
    )
    assert "[30.0, 40.0]" in text and "mu (kPa)" in text
    assert text.count("NOT CONVERGED") == 1  # kv_gm_1 of the made-up context
    write_csv([results], tmp_path / "tables")
    kept = pd.read_csv(tmp_path / "tables" / "fake_strip_modulus.csv")
    assert set(kept["provenance"]) == {"measured"}
    assert {"mu_kPa", "mu_q05", "mu_q95", "converged"} <= set(kept.columns)


def test_tables_are_rounded_to_what_their_intervals_support():
    table = pd.DataFrame(
        {"candidate": ["kv_gm_1"], "e_m_percent": [21.4231], "e_m_q05": [20.1], "e_m_q95": [22.3],
         "paper_percent": [21.42], "stable": [True], "frequency_Hz": [np.nan]}
    )  # fmt: skip
    found = readable(table)
    assert found["header"] == ["candidate", "e m (%)", "paper (%)", "stable", "frequency (Hz)"]
    assert found["rows"] == [["kv_gm_1", "21.4 [20.1, 22.3]", "21.42", "yes", "–"]]
    assert found["number"] == [False, True, True, False, True]


EVERY_ANALYSIS = [
    *((computed, (name,)) for name in papers.names_for("membrane")),
    *(
        (structure_contexts.computed, (name, study))
        for name in papers.names_for("minimum_energy_structure")
        if name != "genetic_algorithm"
        for study in ("static", "motion")
    ),
]


@pytest.mark.parametrize(("compute", "which"), EVERY_ANALYSIS)
def test_the_ends_of_every_interval_are_in_order_and_belong_to_a_column(compute, which):
    for table in compute(*which).tables.values():
        columns = [str(c) for c in table.columns]
        low = [c.removesuffix("_q05") for c in columns if c.endswith("_q05")]
        for base in low:
            (value,) = [c for c in columns if c == base or (c.rpartition("_")[0] == base
                        and c not in (f"{base}_q05", f"{base}_q95"))]  # fmt: skip
            inside = table[[value, f"{base}_q05", f"{base}_q95"]].dropna()
            assert np.all(inside[f"{base}_q05"] <= inside[f"{base}_q95"])
