"""The report's notices: which are serious, and what each of them says."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.report.test_tables import candidate
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes.figures.results import StudyResults
from deabayes.report import notices
from deabayes.sampling.diagnostics import Failed

LENGTH = "relaxation.tau_ou"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    fake = Fake(candidates=(1, 2), protocols=("relaxation", "relaxation"))
    return write_study(tmp_path_factory.mktemp("results"), fake)


@pytest.fixture
def study(folder: Path) -> StudyResults:
    """Results read anew, so that a test may change them."""
    return StudyResults(folder)


def titled(found: list[notices.Notice]) -> dict[str, notices.Notice]:
    return {notice.title: notice for notice in found}


def test_a_clean_study_has_no_serious_notice(study: StudyResults) -> None:
    found = notices.of_study(study)
    assert {n.title for n in found if n.serious} <= {"Set by the prior, not by the data"}


def test_a_warning_of_a_record_stands_under_data_only(study: StudyResults) -> None:
    name, record = next(iter(study.experiments.items()))
    study.experiments[name] = replace(record, warnings=("3 gaps",))  # type: ignore[index]
    warnings = [f"{name}: 3 gaps", "prior_from: no normal"]
    study.recommended.attributes["warnings"] = warnings  # type: ignore[index]
    found = titled(notices.of_study(study))
    assert found["Data"].details == (f"{name}: 3 gaps",)
    assert found["Warnings of the fit"].details == ("prior_from: no normal",)


@pytest.mark.parametrize("converged", [True, False])
def test_warnings_of_the_fit_are_shown_for_unconverged_candidates(
    study: StudyResults, converged: bool
) -> None:
    """They may say why; those of another candidate that converged are not shown."""
    (other,) = (c for c in study.candidates if c is not study.recommended)
    other.attributes["warnings"] = ["tau_1: slower than the records"]  # type: ignore[index]
    other.attributes["convergence"]["converged"] = converged
    details = [n.details for n in notices.of_study(study) if n.candidate == other.name]
    assert (("tau_1: slower than the records",) in details) is not converged


@pytest.mark.parametrize("noise", ["ornstein_uhlenbeck_offset", "matern32", "ar1"])
def test_the_notices_on_noise_know_every_model(tmp_path: Path, noise: str) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), noise=noise, correlated_noise=40e3)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    (text,) = notices.noise_replaces_physics(results)
    assert "correlated noise explains" in text
    assert not list(notices.noise_for_diagnosis(results))
    (length,) = (n for n in results.names("noise") if ".tau_" in n)
    results.prior[length].values[:] *= 0.1
    (text,) = notices.noise_at_its_bound(results)
    assert re.match(rf"{length}: \d.* s, at the upper end of its prior", text)


@pytest.mark.parametrize(("noise", "title"), [("white", "White"), ("student_t", "Student t")])
def test_independent_noise_is_for_diagnosis_only(tmp_path: Path, noise: str, title: str) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), noise=noise)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    (text,) = notices.noise_for_diagnosis(results)
    assert text.startswith(f"{title} noise") and "diagnosis only" in text
    assert not list(notices.noise_replaces_physics(results))
    assert not list(notices.noise_at_its_bound(results))


def test_a_correlation_length_at_the_end_of_its_prior(study: StudyResults) -> None:
    results = study.recommended
    assert not list(notices.noise_at_its_bound(results))
    results.prior[LENGTH].values[:] *= 0.1
    (text,) = notices.noise_at_its_bound(results)
    assert text.startswith(f"{LENGTH}: 29.4 s, at the upper end of its prior")
    results.posterior[LENGTH].attrs["unit"] = "1"
    results.attributes["study"]["noise_coordinate"] = "grid"
    (text,) = notices.noise_at_its_bound(results)
    assert " points, at the upper end" in text


def test_notices_say_what_decided_a_parameter(study: StudyResults) -> None:
    results, table = study.recommended, study.recommended.summary
    assert table is not None and table.loc["zeta_alpha", "contraction"] < 0.1
    columns = ["prior_sensitivity", "likelihood_sensitivity"]
    table.loc["mu_alpha", columns] = [0.234, 0.412]
    table.loc["tau_beta_1", columns] = [0.2, 0.01]
    found = titled(notices.of_candidate(results))
    for title, name, serious in (
        ("Moved by prior and data", "mu_alpha", False),
        ("Moved by the prior", "tau_beta_1", False),
        ("Set by the prior, not by the data", "zeta_alpha", True),
    ):
        assert found[title].details[0].startswith(f"{name}: ")
        assert found[title].serious is serious
    assert "More data of this kind hardly help" in found["Moved by the prior"].details[0]
    # A posterior as wide as its prior is not set by the prior if the data move it.
    table.loc["zeta_alpha", columns] = [0.3, 0.3]
    found = titled(notices.of_candidate(results))
    assert "Set by the prior, not by the data" not in found
    assert "zeta_alpha" in found["Moved by prior and data"].details[0]


def test_only_held_out_records_show_that_bands_are_too_narrow() -> None:
    assert list(notices.narrow_bands(candidate())) == [
        "b: the 90 % predictive band holds 69 % of the points"
    ]


def test_fitted_records_that_reject_the_model() -> None:
    (text,) = notices.rejecting_records(candidate())
    assert text.startswith("a: the residuals do not follow the noise model (p = 0.05), and the 90 ")


def test_records_with_one_reason_stand_together() -> None:
    assert list(notices.extrapolation(candidate())) == ["b, c: too far"]


@pytest.mark.parametrize(("failed", "shown"), [(1, []), (2, ["2 of 1000 model evaluations fail"])])
def test_one_failure_in_a_thousand_needs_no_notice(failed: int, shown: list[str]) -> None:
    assert [text[:32] for text in notices.failed_evaluations(candidate(failed))] == shown


def test_failed_predictions_say_why() -> None:
    predictions = {
        "a": SimpleNamespace(attrs={"failed_draws": 0}),
        "b": SimpleNamespace(attrs={"failed_draws": 3, "failure": "3 of 9 pull in"}),
    }
    found = notices.failed_predictions(candidate(predictions=predictions))
    assert list(found) == ["b: 3 of 9 pull in; they are left out"]


SAMPLING = {"max_steps": 400, "ess": 400.0, "autocorrelation_times": 50.0}
STUCK = "2 of 48 walkers are stuck; start again with another seed"
INHERITED = "its prior is the posterior a/b_2/posterior.nc, which did not converge"
FAILED = [
    *(Failed("r_hat", name, f"R-hat {value:.3f} is not below 1.01", value)
      for name, value in (("mu_1", 1.02), ("tri.sigma_ou", 1.033), ("J", 1.011))),
    Failed("stuck", "run 1", STUCK, 2.0, longer=False),
    *(Failed("ess_bulk", name, f"rests on {size} effective draws", -size)
      for name, size in (("mu_1", 157.0), ("J", 88.0))),
    Failed("length", "the runs", "only 9 autocorrelation times long", -9.0),
]  # fmt: skip
MEASURED = {"length": 10.0, "ess_bulk_min": 88.0, "ess_tail_min": 300.0}


def stored(*failed: Failed, others: tuple[str, ...] = ()) -> dict[str, object]:
    return {
        "reasons": [*map(str, failed), *others],
        "failed_gates": [asdict(each) for each in failed],
    }


def test_every_gate_is_named_once_with_its_worst_case_and_advice_comes_last() -> None:
    convergence = stored(*FAILED, others=(INHERITED,)) | {"steps": 410, **MEASURED}
    assert notices.convergence_reasons(convergence, SAMPLING) == [
        "tri.sigma_ou: R-hat 1.033 is not below 1.01 (the worst of 3)",
        f"run 1: {STUCK}",
        "J: rests on 88.0 effective draws (the worst of 2)",
        "the runs: only 9 autocorrelation times long",
        INHERITED,
        "Sample longer: set sampling.max_steps to 2100 or more (now 400). This number follows from "
        "the autocorrelation time of the runs so far; see docs/how-to/not-converged.md",
    ]


@pytest.mark.parametrize(
    ("measured", "advice"),
    [
        ({"steps": 400, "length": 45.0}, "to 800 or more"),
        ({"steps": 400, "ess_tail_min": 20.0}, "to 8000 or more"),
        ({}, "double sampling.max_steps"),
    ],
)
def test_the_advised_number_of_steps(measured: dict[str, float], advice: str) -> None:
    assert advice in notices.convergence_reasons(stored(FAILED[0]) | measured, SAMPLING)[-1]


def test_longer_runs_are_not_advised_if_they_do_not_help() -> None:
    reasons = notices.convergence_reasons(stored(FAILED[3], others=(INHERITED,)), SAMPLING)
    assert reasons == [f"run 1: {STUCK}", INHERITED]
    assert notices.convergence_reasons({}, {}) == []
