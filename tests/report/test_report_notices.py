"""The report's notices: which are serious, and what each of them says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes.figures.results import StudyResults
from deabayes.report import notices
from deabayes.report.notices import (
    noise_at_its_bound,
    noise_diagnostic_only,
    noise_took_physics,
)


def test_clean_study_raises_no_serious_notice(tmp_path: Path) -> None:
    fake = Fake(candidates=(1, 2), protocols=("relaxation", "relaxation"))
    found = notices.of_study(StudyResults(write_study(tmp_path, fake)))
    assert {n.title for n in found if n.serious} <= {"Set by the prior, not by the data"}


def test_a_warning_of_a_record_stands_once(tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), warnings=("3 gaps",))
    results = StudyResults(write_study(tmp_path, fake))
    (said,) = (n for n in notices.of_study(results) if n.title == "Data")
    (of_record,) = said.details
    results.recommended.attributes["warnings"] = [of_record, "prior_from: no normal"]
    (of_fit,) = notices.stored(results.recommended)
    assert of_fit.details == ("prior_from: no normal",)


def test_what_the_fit_says_of_an_unconverged_candidate_is_shown_too(tmp_path: Path) -> None:
    """Why it may have been held up; of a converged one that is not shown in full it is not."""
    fake = Fake(candidates=(1, 2), protocols=("relaxation",))
    results = StudyResults(write_study(tmp_path, fake))
    (other,) = (c for c in results.candidates if c is not results.recommended)
    other.attributes["warnings"] = ["tau_1: slower than the records"]
    for converged in (True, False):
        other.attributes["convergence"]["converged"] = converged
        said = [n.details for n in notices.of_study(results) if n.candidate == other.name]
        assert (("tau_1: slower than the records",) in said) is not converged


def test_noise_at_the_end_of_its_prior_is_said(tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",))
    results = StudyResults(write_study(tmp_path, fake)).recommended
    assert not list(noise_at_its_bound(results))
    results.prior["relaxation.tau_ou"].values[:] *= 0.1
    (notice,) = noise_at_its_bound(results)
    assert notice.serious
    assert notice.details[0].startswith("relaxation.tau_ou: 30")


@pytest.mark.parametrize(
    "noise", ["ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "matern32", "ar1"]
)
def test_the_notices_on_noise_know_every_model(tmp_path: Path, noise: str) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), noise=noise, correlated_noise=40e3)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    (notice,) = noise_took_physics(results)
    assert notice.serious and "correlated noise explains" in notice.details[0]
    assert not list(noise_diagnostic_only(results))
    (length,) = (n for n in results.names("noise") if ".tau_" in n)
    results.prior[length].values[:] *= 0.1
    (notice,) = noise_at_its_bound(results)
    assert re.match(rf"{length}: \d.* s, at the upper end of its prior", notice.details[0])


@pytest.mark.parametrize(("noise", "title"), [("white", "White"), ("student_t", "Student t")])
def test_noise_for_diagnosis_only_is_said(tmp_path: Path, noise: str, title: str) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",), noise=noise)
    results = StudyResults(write_study(tmp_path, fake)).recommended
    (notice,) = noise_diagnostic_only(results)
    assert notice.title == f"{title} noise"
    assert "diagnostic only" in notice.details[0]
    assert not list(noise_took_physics(results))
    assert not list(noise_at_its_bound(results))


def test_a_bound_of_noise_along_the_grid_is_in_points(tmp_path: Path) -> None:
    fake = Fake(candidates=(1,), protocols=("relaxation",))
    results = StudyResults(write_study(tmp_path, fake)).recommended
    results.prior["relaxation.tau_ou"].values[:] *= 0.1
    results.posterior["relaxation.tau_ou"].attrs["unit"] = "1"
    results.attributes["study"]["noise_coordinate"] = "grid"
    (notice,) = noise_at_its_bound(results)
    assert " points, at the upper end" in notice.details[0]


def test_the_notice_on_priors_says_what_helps(tmp_path: Path) -> None:
    fake = Fake(sensitivities={"tau_beta_1": (0.2, 0.01)})
    found = StudyResults(write_study(tmp_path, fake)).candidates[0]
    (notice,) = notices.moved_by_prior(found)
    assert "the remaining uncertainty comes from priors" in notice.details[0]
    assert "more data of this kind hardly help" in notice.details[0]
