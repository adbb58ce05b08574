"""What a job is made of: a candidate's settings hold nothing of other candidates."""

from __future__ import annotations

from pathlib import Path

from tests.shared.study_folders import make_folder

from deabayes.pipeline.jobs import candidate_settings, prepared_rows, study_folder
from deabayes.study import Study

KNOWN = {"distribution": "lognormal", "median": 1.0, "sigma": 0.5}


def test_a_prior_of_another_candidate_is_not_among_the_settings(tmp_path: Path) -> None:
    names = ("mu_alpha", "mu_beta_2", "tau_beta", "sigma_white", "mu_gamma")
    priors = dict.fromkeys(names, KNOWN)
    study = Study("s", make_folder(tmp_path), ("kv_gm_1", "kv_gm_2"), priors=priors)
    folder = study_folder(study)
    rows = prepared_rows(study, folder)
    one, two = (candidate_settings(study, name, folder, rows) for name in study.candidates)
    assert list(one["priors"]) == ["mu_alpha", "tau_beta", "sigma_white", "mu_gamma"]
    assert tuple(two["priors"]) == names  # the fit refuses mu_gamma, which is nowhere
