"""What a job is made of: a candidate's settings hold nothing of other candidates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.shared.study_folders import make_folder

from deabayes.checks.study import check_study
from deabayes.inference.default_priors import further_prior
from deabayes.pipeline.fit import build_target
from deabayes.pipeline.jobs import candidate_settings, prepared_rows, study_folder
from deabayes.pipeline.prepare import prepare_study
from deabayes.prior.parameter import Parameter
from deabayes.studies import load_studies
from deabayes.study import Study, from_settings

ROOT = Path(__file__).parents[2]

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


def narrowed(parameter: Parameter) -> dict[str, object]:
    """A prior about the median of the default one, in SI."""
    middle = float(parameter.prior.from_normal(np.zeros(1))[0])
    if middle > 0.0:
        return {"distribution": "lognormal", "median": middle, "sigma": 0.1}
    return {"distribution": "normal", "mean": middle, "sd": 0.1}


@pytest.mark.parametrize("name", ["tubular", "membrane", "minimum_energy_structure"])
def test_every_prior_that_the_check_takes_is_taken_by_every_fit(name: str, tmp_path: Path) -> None:
    """Parameters of all candidates, of the model that predicts, of noise with and without group."""
    studies = {study.name: study for study in load_studies(ROOT / "config.yaml")}
    study = replace(studies[name], prior_from=None, priors={}, specimen=ROOT / "data" / name)
    prepare_study(study, tmp_path)
    priors: dict[str, dict[str, object]] = {}
    for candidate in study.candidates:
        target = build_target(study, candidate, tmp_path)
        further = further_prior(study, target.system, target.names)
        for p in (*target.prior.parameters, *(further.parameters if further else ())):
            key = p.ordered or p.part_of or p.name
            priors |= {each: narrowed(p) for each in (key, key.rpartition(".")[2])}
    asked = replace(study, priors=priors)
    assert check_study(asked).faults == []
    folder = study_folder(asked)
    rows = prepared_rows(asked, folder)
    for candidate in study.candidates:
        settings = candidate_settings(asked, candidate, folder, rows)
        fitted = from_settings({"name": name, **settings})
        target = build_target(fitted, candidate, tmp_path)
        further = further_prior(fitted, target.system, target.names)
        sources = {
            p.source for p in (*target.prior.parameters, *(further or target.prior).parameters)
        }
        assert sources == {"config"}
