"""A population of three tubes, put together from their posterior files; nothing is converged."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from tests.workflow.snakemake_runs import ROOT, TINY, snakemake

import deabayes
from deabayes import figures, pipeline
from deabayes.faults import UserError
from deabayes.figures.results import PopulationResults
from deabayes.population.settings import SETTINGS, Population, write_population
from deabayes.posteriors.storage import read_tree, write_tree
from deabayes.records.preparation.prepared import read_prepared, write_prepared
from deabayes.report import build
from deabayes.studies import load_study, write_study
from deabayes.study import Sampling

RECORDS = {"tube_a": "creep_2000V", "tube_b": "creep_2500V", "tube_c": "creep_1500V"}
BUDGET = Sampling(ensembles=2, walkers=24, max_steps=120, particles=64, seed=1)
TUBES = Population(
    "tubes",
    tuple(RECORDS),
    "voigt_kelvin_1",
    ("E_0", "E_1", "tau_1"),
    sampling=replace(BUDGET, max_steps=400),
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three fits of the shipped tube, one record each, and their population."""
    folder = tmp_path_factory.mktemp("population")
    results = folder / "results"
    (folder / "config.yaml").write_text(TINY.format(root=ROOT))
    tiny = load_study(folder / "config.yaml", "tiny")
    for name, record in RECORDS.items():
        study = replace(tiny, name=name, calibrate=(record,), validate=(), sampling=BUDGET)
        own = results / name / "voigt_kelvin_1"
        write_study(study, results / name / "study.yaml")
        pipeline.prepare_study(study, results / name / "prepared")
        args = study, "voigt_kelvin_1", results / name / "prepared"
        pipeline.fit_candidate(*args, own / "posterior.nc", own / "summary.csv", False)
    write_population(TUBES, results / "populations" / "tubes" / SETTINGS)
    said = pipeline.fit_population(TUBES, results, results / "populations" / "tubes", False)
    (results / "said.txt").write_text(said)
    return results


@pytest.fixture(scope="module")
def tubes(results: Path) -> PopulationResults:
    return PopulationResults(results / "populations" / "tubes")


def test_tables_have_a_row_for_each_number(tubes: PopulationResults) -> None:
    names = ["E_0", "E_1", "tau_1"]
    assert list(tubes.summary.index) == [p + n for p in ("", "mean_", "spread_") for n in names]
    assert list(tubes.summary.loc[["E_0", "mean_E_0", "spread_E_0"], "unit"]) == ["Pa", "Pa", "1"]
    table = tubes.shrinkage
    assert len(table) == 9
    assert table["shrinkage"].between(0, 1).all()
    inside = (table["shrunken_q05"] < table["shrunken_median"]) & (
        table["shrunken_median"] < table["shrunken_q95"]
    )
    assert inside.all()


def test_unconverged_members_are_said_and_marked(results: Path, tubes: PopulationResults) -> None:
    said = (results / "said.txt").read_text()
    assert "NOT converged" in said
    assert "tube_b: its own posterior has not converged" in said
    assert not tubes.summary["converged"].any()
    assert not tubes.converged
    for name in figures.names("population"):
        (figure,) = figures.draw(name, tubes)
        words = [text.get_text() for text in figure.texts]
        assert "NOT CONVERGED" in words
        assert "simulated data" in words


def test_a_new_specimen_is_a_posterior_like_any_other(tubes: PopulationResults) -> None:
    post = deabayes.open_posterior(tubes.folder / "posterior.nc")
    names, draws = post.as_prior()
    assert names == ("E_0", "E_1", "tau_1")
    assert np.all(draws > 0)
    time = np.linspace(1e-3, 0.5, 5)
    bands = post.predict(time=time, voltage=np.full(5, 2000.0), size=50)
    assert np.all(np.isfinite(bands["predictive"]))
    assert not bands.attrs["converged"]


def test_a_new_specimen_is_known_less_well_than_the_mean(tubes: PopulationResults) -> None:
    summary = tubes.summary
    for name in tubes.parameters:
        new, mean = (np.log(summary.loc[p + name, ["q05", "q95"]]) for p in ("", "mean_"))
        assert np.ptp(new) > np.ptp(mean)


def test_another_study_takes_it_for_its_prior(
    results: Path, tubes: PopulationResults, tmp_path: Path
) -> None:
    study = load_study(results / "tube_a" / "study.yaml")
    prior = str(tubes.folder / "posterior.nc")
    study = replace(study, calibrate=("creep_2500V",), prior_from=prior)
    prepared = results / "tube_b" / "prepared"
    with pytest.raises(UserError, match=r"record creep_2500V was fitted in study tube_b"):
        pipeline.build_target(study, "voigt_kelvin_1", prepared)
    other = read_prepared(prepared / "creep_2500V.nc")
    other = replace(other, response=1.01 * other.response, record_sha256="of another file")
    write_prepared(other, tmp_path / "creep_2500V.nc")
    target = pipeline.build_target(study, "voigt_kelvin_1", tmp_path)
    (block,) = target.prior.inherited
    assert block.names == ("E_0", "E_1", "tau_1")


def test_predictions_are_of_the_first_members_records(tubes: PopulationResults) -> None:
    with xr.open_dataset(tubes.folder / "predictions" / "creep_2000V.nc") as bands:
        width = bands["predictive"].sel(level=0.9)
        assert np.all(width.sel(bound="upper") > width.sel(bound="lower"))
    table = pd.read_csv(tubes.folder / "errors.csv")
    assert list(table["experiment"]) == ["creep_2000V"]


def test_figures_and_page(results: Path, tubes: PopulationResults, tmp_path: Path) -> None:
    saved = figures.save_all(tubes.folder, tubes.folder / "figures")
    assert [each.name for each in saved] == ["shrinkage", "new_specimen"]
    assert figures.saved_figures(tubes.folder, tubes.folder / "figures") == saved
    page = build([tubes.folder], tmp_path / "index.html", tmp_path / "tables").read_text()
    assert "Population not converged" in page
    assert "tubes, population" in page
    assert "With the population" in page
    table = pd.read_csv(tmp_path / "tables" / "population_tubes_shrinkage.csv")
    assert len(table) == 9


def test_another_prior_than_the_posteriors_is_refused(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "results"
    shutil.copytree(results, copy)
    path = copy / "tube_b" / "voigt_kelvin_1" / "posterior.nc"
    tree = read_tree(path)
    study = json.loads(tree.attrs["study"])
    study["priors"] = {"E_0": {"distribution": "lognormal", "median": "3 MPa", "sigma": 0.2}}
    tree.attrs["study"] = json.dumps(study)
    write_tree(tree, path)
    with pytest.raises(UserError, match=r"tube_b: its prior .* has changed since"):
        pipeline.fit_population(TUBES, copy, copy / "populations" / "tubes", False)


def planned(folder: Path, **population: object) -> Path:
    """A config of three copies of the shipped tube, and a population of them."""
    tiny = yaml.safe_load(TINY.format(root=ROOT))
    for name in RECORDS:
        if not (folder / name).is_dir():
            shutil.copytree(ROOT / "data" / "tubular", folder / name)
    one = tiny["studies"]["tiny"]
    one.pop("further_experiments", None)
    tiny["studies"] = {
        name: one | {"specimen": name, "calibrate": [record], "validate": []}
        for name, record in RECORDS.items()
    }
    entry = {"studies": list(RECORDS), "candidate": "voigt_kelvin_1", "parameters": ["E_0"]}
    tiny["populations"] = {"tubes": entry | population}
    (folder / "mine.yaml").write_text(yaml.safe_dump(tiny))
    return folder / "mine.yaml"


def test_the_workflow_plans_a_population_after_its_members(tmp_path: Path) -> None:
    run = snakemake(tmp_path, "--cores", "1", "--dry-run", "--configfile", planned(tmp_path))
    assert run.returncode == 0, run.stderr
    assert "results/populations/tubes/posterior.nc" in run.stdout
    assert "results/populations/tubes/figures" in run.stdout
    assert "results/tube_c/voigt_kelvin_1/posterior.nc" in run.stdout


def test_the_workflow_says_a_populations_mistakes(tmp_path: Path) -> None:
    path = planned(tmp_path, studies=["tube_a", "tube_b"], parameters=["E_9"])
    run = snakemake(tmp_path, "--cores", "1", "--dry-run", "--configfile", path)
    assert run.returncode != 0
    assert "Traceback" not in run.stderr
    assert "populations.tubes, studies: 2 specimens" in run.stderr
    assert "'E_9'" in run.stderr
