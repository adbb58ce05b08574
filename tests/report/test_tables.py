"""Numbers in the report's tables, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from deabayes.report import tables

NAN = float("nan")
ERRORS = pd.DataFrame(
    {
        "experiment": ["a", "b", "c"],
        "role": ["calibrate", "validate", "validate"],
        "protocol": "load_unload",
        "e_rms_percent": 1.234, "e_rms_q05": 1.0, "e_rms_q95": 1.5,
        "e_m_percent": 4.321, "e_m_q05": 4.0, "e_m_q95": 5.0,
        "coverage_50": [0.5, 0.4, 0.6], "coverage_90": [0.3, 0.69, 0.71],
        "crps": [2e-5, 3e-5, 4e-5], "pit_p": [0.05, 0.0123, 1e-9],
        "extrapolation": [NAN, "too far", "too far"],
    }
)  # fmt: skip


def candidate(failed=0, predictions=None, errors=ERRORS):
    attributes = {"response_unit": "m", "response_name": "displacement"}
    return SimpleNamespace(
        name="one", study=SimpleNamespace(name="study"), errors=errors,
        convergence={"failures": {"evaluations": 1000, "failed": failed}},
        predictions=predictions or {n: SimpleNamespace(attrs=attributes) for n in "abc"},
    )  # fmt: skip


def test_errors_are_in_percent_and_the_score_has_the_responses_unit():
    found = tables.errors(candidate())
    (row,) = found["calibration"]
    assert row == {
        "experiment": "a", "protocol": "load unload", "e_rms": "1.23 [1.00, 1.50]",
        "e_m": "4.32 [4.00, 5.00]", "coverage_50": "50 %", "coverage_90": "30 %",
        "crps": "20.0 µm", "pit": "not as predicted, p = 0.050", "extrapolation": "",
        "flagged": True,
    }  # fmt: skip
    held_out = found["held out"]
    assert [row["experiment"] for row in held_out] == ["b", "c"]
    assert [row["extrapolation"] for row in held_out] == ["too far", "too far"]
    assert [row["pit"] for row in held_out] == [
        "not as predicted, p = 0.012", "not as predicted, p < 0.001"
    ]  # fmt: skip


@pytest.mark.parametrize("old", [False, True])
def test_an_unknown_score_is_an_empty_cell(old):
    scores = ["coverage_50", "coverage_90", "crps", "pit_p"]
    errors = ERRORS.assign(**dict.fromkeys(scores, NAN))
    errors = errors.drop(columns="pit_p") if old else errors
    (row,) = tables.errors(candidate(errors=errors))["calibration"]
    assert [row[score] for score in [*scores[:3], "pit"]] == ["", "", "", ""]


def test_scores_of_the_comparison():
    row = {
        "n_parameters": 5, "log_evidence": -1234.56, "log_evidence_mcse": 0.26,
        "log_evidence_nested": -1234.0, "log_evidence_nested_error": 0.4, "bic": 2500.04,
        "elpd_block_loo": -0.04, "elpd_block_loo_se": NAN,
        "elpd_leave_one_experiment_out": NAN, "worst_k_hat": 0.456, "converged": True,
        "verdict": "chosen",
    }  # fmt: skip
    study = SimpleNamespace(
        comparison=pd.DataFrame([row], index=["one"]), recommended=SimpleNamespace(name="one")
    )
    (found,) = tables.comparison(study)
    assert found["shown"] and found["n_parameters"] == 5
    assert found["log_evidence"] == "−1234.6 ± 0.3"
    assert found["log_evidence_nested"] == "−1234.0 ± 0.4"
    assert (found["bic"], found["elpd"], found["k_hat"]) == ("2500.0", "0.0", "0.46")
    assert found["left_out"] == "–"
    assert tables.has_nested(study)


def test_a_range_is_in_one_unit_and_noise_about_zero_is_zero():
    values = np.array([1e-6, 2e-3, 5e-3])
    assert tables._range(values, "m", "displacement") == ("displacement", "0 – 5 mm")
    assert tables._range(np.full(3, 4e3), "V", "voltage") == ("voltage", "4 kV")
    assert tables._range(np.array([0.01, 0.2]), "1", "strain") == ("strain", "1 – 20 %")


def test_metadata_of_a_record_have_their_units():
    stated = {
        "note": "second pull", "load_g": 300.0, "bias_kV": 2.0, "stretch_rate_per_s": 0.05,
        "crosshead_mm_per_min": 500.0, "deformation": "uniaxial", "batch_s": "B", "stretch": 2.0,
        "amplitude_kV": NAN,
    }  # fmt: skip
    assert tables.about(stated) == (
        "load 300 g; bias 2 kV; stretch rate 0.05 1/s; crosshead 500 mm/min; "
        "deformation uniaxial; batch s B; stretch 2; second pull"
    )


@pytest.mark.parametrize(
    ("described", "name"),
    [
        ("log-uniform, lower 0.1333, upper 1593, ascending (tau)", "log-uniform"),
        (
            "half of mu_1 alpha_1: log-normal, median 50e3, sigma 2",
            "half of mu_1 alpha_1: log-normal",
        ),
        ("posterior of another study, a likelihood learned from", "posterior of another study"),
        ("half-normal, sd 3", "half-normal"),
        ("", ""),
    ],
)
def test_the_name_of_a_prior_has_no_settings(described, name):
    assert tables.law(described) == name


def test_further_experiments_name_their_cautions():
    row = {
        "experiment": "5 kV", "what": "step 5 kV", "held_out": False, "candidates": "one, two",
        "information_candidate_nats": 0.5, "information_candidate_error_nats": 0.01,
        "probability_right": 0.9, "probability_right_error": 0.01, "failed_share": 1.0,
        "failure": "one: 9 × pull-in", "extrapolation": NAN, "information_one_nats": NAN,
        "information_two_nats": 3.0,
    }  # fmt: skip
    (found,) = tables.further_experiments(SimpleNamespace(further_experiments=pd.DataFrame([row])))
    assert (found["probability"], found["candidate"]) == ("0.90 ± 0.01", "0.50 ± 0.01")
    assert found["parameters"] == ["one –", "two 3.0"]
    assert found["cautions"] == [
        "100 % of the draws have no response (one: 9 × pull-in): the specimen may not survive it"
    ]
    held_out = pd.DataFrame([row | {"held_out": True}])
    (found,) = tables.further_experiments(SimpleNamespace(further_experiments=held_out))
    assert found["cautions"] == ["you have it: move it to `calibrate`"]
