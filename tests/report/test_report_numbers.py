"""The numbers of the report's tables and notices, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from deabayes.report import notices, sections, tables

ERRORS = pd.DataFrame(
    {
        "experiment": ["a", "b", "c"],
        "role": ["calibrate", "validate", "validate"],
        "protocol": "load_unload",
        "e_rms_percent": 1.234, "e_rms_q05": 1.0, "e_rms_q95": 1.5,
        "e_m_percent": 4.321, "e_m_q05": 4.0, "e_m_q95": 5.0,
        "coverage_50": [0.5, 0.4, 0.6], "coverage_90": [0.3, 0.69, 0.71],
        "crps": [2e-5, 3e-5, 4e-5], "pit_p": [0.05, 0.0123, 1e-9],
        "extrapolation": ["", "too far", "too far"],
    }
)  # fmt: skip


def candidate(failed=0, predictions=None, evaluations=1000):
    attributes = {"response_unit": "m", "response_name": "displacement"}
    return SimpleNamespace(
        name="one", study=SimpleNamespace(name="study"), errors=ERRORS,
        convergence={"failures": {"evaluations": evaluations, "failed": failed}},
        predictions=predictions or {n: SimpleNamespace(attrs=attributes) for n in "abc"},
    )  # fmt: skip


def test_errors_are_in_percent_and_the_response_has_its_unit():
    found = tables.errors(candidate())
    assert [row["experiment"] for row in found["held out"]] == ["b", "c"]
    (row,) = found["calibration"]
    assert row["protocol"] == "load unload"
    assert (row["e_rms"], row["e_m"]) == ("1.23 [1.00, 1.50]", "4.32 [4.00, 5.00]")
    assert (row["coverage_50"], row["coverage_90"]) == ("50 %", "30 %")
    assert row["crps"] == "20.0 µm"
    assert found["held out"][0]["extrapolation"] == "too far"


def test_whether_points_fall_as_predicted_is_in_words():
    found = tables.errors(candidate())
    said = [row["pit"] for row in found["calibration"] + found["held out"]]
    assert said == [
        "as predicted, p = 0.050", "not as predicted, p = 0.012", "not as predicted, p < 0.001"
    ]  # fmt: skip


def test_only_held_out_records_tell_that_bands_are_too_narrow():
    (notice,) = notices.narrow_bands(candidate())
    assert notice.details == ("b: the 90 % predictive band holds 69 %",)


def test_records_with_one_reason_stand_together():
    (notice,) = notices.extrapolation(candidate())
    assert notice.details == ("b, c: too far",)


@pytest.mark.parametrize(("failed", "said"), [(1, []), (2, ["2 of 1000 model evaluations failed"])])
def test_one_failure_in_a_thousand_is_not_worth_a_notice(failed, said):
    found = [n.details[0].split(" (")[0] for n in notices.failures(candidate(failed))]
    assert found == said


def test_failed_predictions_say_why():
    predictions = {
        "a": SimpleNamespace(attrs={"failed_draws": 0}),
        "b": SimpleNamespace(attrs={"failed_draws": 3, "failure": "3 of 9 pull in"}),
    }
    (notice,) = notices.failures(candidate(predictions=predictions))
    assert notice.details == ("b: 3 of 9 pull in; left out",)


def test_scores_of_the_comparison():
    row = {
        "n_parameters": 5, "log_evidence": -1234.56, "log_evidence_mcse": 0.26,
        "log_evidence_nested": -1234.0, "log_evidence_nested_error": 0.4, "bic": 2500.04,
        "elpd_block_loo": -0.04, "elpd_block_loo_se": np.nan,
        "elpd_leave_one_experiment_out": np.nan, "worst_k_hat": 0.456, "converged": True,
        "verdict": "chosen",
    }  # fmt: skip
    study = SimpleNamespace(
        comparison=pd.DataFrame([row], index=["one"]), recommended=SimpleNamespace(name="one")
    )
    (found,) = sections.order_rows(study)
    assert found["shown"] and found["n_parameters"] == 5
    assert found["log_evidence"] == "−1234.6 ± 0.3"
    assert found["log_evidence_nested"] == "−1234.0 ± 0.4"
    assert (found["bic"], found["elpd"], found["k_hat"]) == ("2500.0", "0.0", "0.46")
    assert found["left_out"] == "–"
    assert sections.asked_for_nested(study)


def test_a_range_is_shown_in_one_unit_and_noise_about_zero_is_zero():
    values = np.array([1e-6, 2e-3, 5e-3])
    assert tables._range(values, "m", "displacement") == ("displacement", "0 – 5 mm")
    assert tables._range(np.full(3, 4e3), "V", "voltage") == ("voltage", "4 kV")
    assert tables._range(np.array([0.01, 0.2]), "1", "strain") == ("strain", "1 – 20 %")
