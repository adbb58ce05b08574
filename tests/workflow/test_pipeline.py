"""The whole line in one process, on creep records without mass, with a small budget."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.workflow.creep_study import write_creep_study

import deabayes
from deabayes import pipeline
from deabayes.cli.main import main
from deabayes.export import export
from deabayes.faults import UserError
from deabayes.posteriors.storage import read_tree, write_tree
from deabayes.studies import load_study
from deabayes.study import Sampling

ROOT = Path(__file__).parents[2]
CANDIDATES = ("voigt_kelvin_1", "voigt_kelvin_2")
SUMMARY = (
    "parameter symbol unit mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat "
    "contraction prior_sensitivity likelihood_sensitivity converged"
).split()
ERRORS = (
    "experiment role protocol e_rms_percent e_rms_q05 e_rms_q95 e_m_percent e_m_q05 e_m_q95 "
    "coverage_50 coverage_90 crps pit_p extrapolation"
).split()
COMPARISON = (
    "candidate order n_parameters log_evidence log_evidence_mcse bic elpd_block_loo "
    "elpd_block_loo_se elpd_leave_one_experiment_out worst_k_hat converged verdict"
).split()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Fit two candidates to two creep records, score, predict and compare them."""
    folder = tmp_path_factory.mktemp("results")
    study = load_study(ROOT / "config.yaml", "tubular")
    settings = Sampling(ensembles=2, walkers=48, particles=256, max_steps=3000, seed=3)
    study = replace(
        study,
        specimen=write_creep_study(ROOT / "data" / "tubular", folder / "creep"),
        candidates=CANDIDATES,
        calibrate=("creep_2000V", "creep_2500V"),
        validate=("creep_1500V",),
        sampling=settings,
        prior_from=None,
        predict_with={},
    )
    prepared = folder / "prepared"
    pipeline.prepare_study(study, prepared)
    for candidate in CANDIDATES:
        own = folder / candidate
        posterior = own / "posterior.nc"
        pipeline.fit_candidate(study, candidate, prepared, posterior, own / "summary.csv", False)
        pipeline.score_candidate(posterior, prepared, own / "scores.json")
        pipeline.predict_candidate(posterior, prepared, own / "predictions", own / "errors.csv")
    posteriors = [folder / candidate / "posterior.nc" for candidate in CANDIDATES]
    pipeline.compare_candidates(posteriors, prepared, folder / "comparison.csv")
    asked = {"longer": {"like": "creep_2000V", "duration": 4}}
    pipeline.further_experiments(folder, asked, folder / "further_experiments.csv")
    return folder


def test_a_warning_about_a_record_is_said_once(tmp_path):
    study = load_study(ROOT / "config.yaml", "tubular")
    study = replace(study, calibrate=("creep_2000V",), validate=("sine_10Hz",))
    sine = next(e for e in pipeline.prepare_study(study, tmp_path) if e.name == "sine_10Hz")
    assert len([w for w in sine.warnings if "current limit" in w]) == 1


@pytest.fixture(scope="module")
def post(results):
    return deabayes.open_posterior(results / "voigt_kelvin_2" / "posterior.nc")


def test_tables_have_the_columns_of_the_contract(results):
    own = results / "voigt_kelvin_2"
    for path, wanted in (
        (own / "summary.csv", SUMMARY),
        (own / "errors.csv", ERRORS),
        (results / "comparison.csv", COMPARISON),
    ):
        table = pd.read_csv(path)
        assert set(wanted) <= set(table.columns), path.name
        assert len(table) > 0


def test_a_decided_order_leaves_one_candidate_to_learn_about(results):
    table = pd.read_csv(results / "further_experiments.csv").set_index("experiment")
    assert set(table.index) == {"creep_1500V", "longer"}
    assert set(table["candidates"]) == {"voigt_kelvin_2"}
    assert table["probability_right"].isna().all()
    assert (table["information_voigt_kelvin_2_nats"] > 0.0).all()


def test_further_experiments_cannot_tell_twins_apart(results, tmp_path):
    """The same posterior under two names, taken as converged."""
    shutil.copytree(results / "prepared", tmp_path / "prepared")
    tree = read_tree(results / "voigt_kelvin_1" / "posterior.nc")
    verdict = "chosen: the smallest order the data cannot do without"
    lines = ["candidate,n_parameters,log_evidence,converged,verdict"]
    for name in ("one", "twin"):
        write_tree(tree, tmp_path / name / "posterior.nc")
        lines.append(f"{name},3,0,True,{verdict if name == 'one' else 'not chosen: elpd 0'}")
    (tmp_path / "comparison.csv").write_text("\n".join(lines))
    asked = "{longer: {like: creep_2000V, duration: 2}, too_much: {like: creep_2000V, speed: 2}}"
    main(["further", str(tmp_path), "--config", str(tmp_path / "none.yaml"), "--asked", asked])
    with (tmp_path / "further_experiments.csv").open(newline="") as stream:
        rows = {row["experiment"]: row for row in csv.DictReader(stream)}
    assert set(rows) == {"creep_1500V", "longer", "too_much"}
    for row in rows.values():
        assert row["candidates"] == "one, twin"
        error = float(row["information_candidate_error_nats"])
        assert float(row["information_candidate_nats"]) <= 3 * error + 1e-9
        assert float(row["information_twin_nats"]) > 0.0


def test_evidence_by_nested_sampling_stands_beside_that_by_bridge(results, tmp_path):
    output = tmp_path / "comparison.csv"
    shutil.copytree(results / "voigt_kelvin_1", tmp_path / "voigt_kelvin_1")
    posterior = tmp_path / "voigt_kelvin_1" / "posterior.nc"
    bridge = json.loads(posterior.with_name("scores.json").read_text())["log_evidence"]
    check = posterior.with_name("nested.json")
    nested = {"log_evidence_nested": bridge - 20.0, "log_evidence_nested_error": 0.2}
    check.write_text(json.dumps(nested))

    def compared():
        pipeline.compare_candidates([posterior], results / "prepared", output)
        return pd.read_csv(output).iloc[0]

    row = compared()
    assert row["log_evidence_nested"] == pytest.approx(bridge - 20.0)
    assert row["log_evidence_nested_error"] == 0.2
    assert "bridge and nested sampling differ by +20" in row["verdict"]
    os.utime(check, (1, 1))  # of a posterior from before this one
    row = compared()
    assert np.isnan(row["log_evidence_nested"]) and "nested" not in row["verdict"]


def test_posterior_finds_the_truth_that_creep_determines(post):
    """The strain per squared voltage of the truth lies within four posterior sds."""
    import yaml

    truth = yaml.safe_load((ROOT / "data/tubular/truth.yaml").read_text())
    summary = post.summary()
    row = summary.loc["tau_2"]
    assert abs(row["mean"] - truth["parameters"]["tau_2"]) < 0.25 * truth["parameters"]["tau_2"]
    assert summary.loc["strain_per_kV2_total", "contraction"] > 0.999


def test_moduli_are_set_by_the_prior_of_the_thickness_and_ratios_are_not(post):
    """Only sigma_0 / E_n is identifiable: relative spread of E_0 against that of the ratio."""
    draws = post.draws(2000)
    spread = draws.std() / draws.mean()
    assert spread["E_0"] > 5 * spread["strain_per_kV2_0"]
    assert post.summary().loc["thickness", "contraction"] < 0.3


def test_more_units_win_where_the_data_show_them(results):
    table = pd.read_csv(results / "comparison.csv").set_index("candidate")
    assert table.loc["voigt_kelvin_2", "log_evidence"] > table.loc["voigt_kelvin_1", "log_evidence"]
    if table["converged"].all():
        assert table.loc["voigt_kelvin_2", "verdict"].startswith("chosen")
        assert table.loc["voigt_kelvin_2", "elpd_difference"] == 0
        assert table["elpd_leave_one_experiment_out"].isna().all()  # one is far behind


def test_records_are_left_out_of_candidates_that_are_close(results, monkeypatch, tmp_path):
    monkeypatch.setattr("deabayes.comparison.ranking.FAR_BEHIND", np.inf)
    posteriors = [results / candidate / "posterior.nc" for candidate in CANDIDATES]
    pipeline.compare_candidates(posteriors, results / "prepared", tmp_path / "comparison.csv")
    table = pd.read_csv(tmp_path / "comparison.csv").set_index("candidate")
    one, two = table["elpd_leave_one_experiment_out"]
    assert one < two


def test_predictions_carry_three_nested_bands(results):
    data = xr.load_dataset(results / "voigt_kelvin_2/predictions/creep_1500V.nc", engine="h5netcdf")
    width = {
        name: float((data[name].sel(bound="upper") - data[name].sel(bound="lower")).mean())
        for name in ("parameter", "discrepancy", "predictive")
    }
    assert width["parameter"] < width["discrepancy"] < width["predictive"]
    assert data.attrs["extrapolation"] == ""


def test_predict_flags_what_lies_outside_the_calibration(post):
    time = np.linspace(0.0, 0.4, 50)
    within = post.predict(time=time, voltage=np.full(50, 2000.0))
    assert within.attrs["extrapolation"] == ""
    higher = post.predict(time=time, voltage=np.full(50, 4000.0))
    assert "voltage" in higher.attrs["extrapolation"]
    longer = post.predict(time=10 * time, voltage=np.full(50, 2000.0))
    assert "1.5 times the longest" in longer.attrs["extrapolation"]
    assert float(higher["median"][-1]) == pytest.approx(4 * float(within["median"][-1]), rel=0.05)


def test_predict_refuses_what_it_cannot_read(post):
    with pytest.raises(UserError, match="did you mean 'voltage'"):
        post.predict(time=np.arange(3.0), voltag=np.arange(3.0))
    with pytest.raises(UserError, match="exactly one excitation"):
        post.predict(time=np.arange(3.0))
    with pytest.raises(UserError, match="must ascend"):
        post.predict(time=np.zeros(3), voltage=np.arange(3.0))


def test_draws_and_prior_keep_names_and_correlations(post):
    assert post.draws(10, seed=4).equals(post.draws(10, seed=4))
    prior = post.as_prior()
    assert "E_0" in prior.names and not any("." in name for name in prior.names)
    columns = dict(zip(prior.names, np.log(prior.draws).T, strict=True))
    assert np.corrcoef(columns["E_0"], columns["thickness"])[0, 1] < -0.3


def test_exports_hold_the_same_draws(post, tmp_path):
    export(post.data, "csv", tmp_path / "draws.csv")
    export(post.data, "json", tmp_path / "draws.json")
    table = pd.read_csv(tmp_path / "draws.csv")
    content = json.loads((tmp_path / "draws.json").read_text())
    np.testing.assert_allclose(table["E_0 [Pa]"], content["parameters"]["E_0"]["draws"])
    assert content["parameters"]["tau_1"]["unit"] == "s"
    with pytest.raises(UserError, match="no export format"):
        export(post.data, "xls", tmp_path / "draws.xls")


def test_opening_a_posterior_loads_no_sampler_and_no_compiler(results):
    code = (
        "import sys, deabayes\n"
        f"post = deabayes.open_posterior({str(results / 'voigt_kelvin_2/posterior.nc')!r})\n"
        "post.summary(); post.draws(10)\n"
        "heavy = {'numba', 'emcee', 'snakemake', 'scipy.stats', 'matplotlib', 'sklearn'}\n"
        "found = heavy & set(sys.modules)\n"
        "sys.exit(f'loaded {found}' if found else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_file_that_is_no_posterior_is_refused(tmp_path, results):
    with pytest.raises(UserError, match="no such file"):
        deabayes.open_posterior(tmp_path / "posterior.nc")
    with pytest.raises(UserError, match="holds no posterior"):
        deabayes.open_posterior(results / "prepared" / "creep_1500V.nc")
