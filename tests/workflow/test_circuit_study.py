"""The shipped study of the circuit on a small budget: its truth, tables, posterior as prior."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import deabayes
from deabayes import pipeline
from deabayes.pipeline.fit import build_target
from deabayes.pipeline.judge import analyse_study
from deabayes.studies import load_study, write_study
from deabayes.study import Sampling

ROOT = Path(__file__).parents[2]
NAMES = ("series_resistance", "leakage_resistance", "capacitance")
FULL = "voigt_kelvin_2_inertia_circuit"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prepared and fitted."""
    folder = tmp_path_factory.mktemp("results") / "tubular_circuit"
    settings = Sampling(ensembles=2, walkers=32, particles=128, max_steps=600, seed=1)
    study = replace(load_study(ROOT / "config.yaml", "tubular_circuit"), sampling=settings)
    folder.mkdir()
    write_study(study, folder / "study.yaml")
    pipeline.prepare_study(study, folder / "prepared")
    own = folder / "circuit"
    files = own / "posterior.nc", own / "summary.csv"
    pipeline.fit_candidate(study, "circuit", folder / "prepared", *files, False)
    return folder


def test_only_the_two_records_are_prepared(results: Path) -> None:
    found = sorted(path.stem for path in (results / "prepared").iterdir())
    assert found == ["electrical_10Hz", "leakage_2000V"]


def test_the_truth_is_found(results: Path) -> None:
    truth = yaml.safe_load((ROOT / "data/tubular/truth.yaml").read_text())["specimen"]
    summary = pd.read_csv(results / "circuit" / "summary.csv").set_index("parameter")
    for name in NAMES:
        row = summary.loc[name]
        assert abs(row["mean"] - truth[name]) < 3.0 * row["sd"], name
        assert row["contraction"] > 0.99, name
    sizes = (summary.loc[list(NAMES), "sd"] / summary.loc[list(NAMES), "mean"]).to_numpy()
    assert np.all(sizes < [0.025, 0.002, 5e-4])


def test_it_is_a_prior_for_the_full_model_with_its_correlations(
    results: Path, tmp_path: Path
) -> None:
    study = replace(
        load_study(ROOT / "config.yaml", "tubular"),
        candidates=(FULL,),
        predict_with={},
        validate=(),
        prior_from=results / "circuit" / "posterior.nc",
    )
    pipeline.prepare_study(study, tmp_path)
    target = build_target(study, FULL, tmp_path)
    assert target.prior.inherited[0].names == NAMES
    theta = target.prior.sample(np.random.default_rng(1), 4000)
    columns = [target.names.index(name) for name in NAMES]
    drawn = deabayes.open_posterior(results / "circuit" / "posterior.nc").draws(4000)[list(NAMES)]
    mine, theirs = np.log(theta[:, columns]), np.log(drawn.to_numpy())
    np.testing.assert_allclose(mine.std(axis=0), theirs.std(axis=0), rtol=0.12)
    shift = np.abs(mine.mean(axis=0) - theirs.mean(axis=0)) / theirs.std(axis=0)
    assert shift.max() < 0.15
    np.testing.assert_allclose(np.corrcoef(mine.T), np.corrcoef(theirs.T), atol=0.12)
    assert np.isfinite(target.log_likelihood(theta[:8])).all()


def test_the_papers_tables_are_written(results: Path, tmp_path: Path) -> None:
    analyse_study(results, tmp_path / "analyses")
    index = json.loads((tmp_path / "analyses" / "index.json").read_text())
    tables = {each["name"]: each["tables"] for each in index}
    assert tables["circuit"] == ["table_3_circuit", "table_3_phase_method"]
    assert tables["amplifier_current"] == ["amplifier_current"]
    method = pd.read_csv(tmp_path / "analyses" / "circuit" / "table_3_phase_method.csv")
    rounded = method.set_index("source").loc["(15), electrical_10Hz, rounded"]
    assert (rounded["phase_rad"], rounded["to_ms"]) == pytest.approx((1.56, 0.251), abs=6e-4)
    asked = pd.read_csv(tmp_path / "analyses" / "amplifier_current" / "amplifier_current.csv")
    sine = asked.set_index("experiment").loc["electrical_10Hz"]
    # omega C V of 1.25 kV at 10 Hz
    assert sine["current_mA"] == pytest.approx(14.23, abs=0.02)
