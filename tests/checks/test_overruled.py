"""Entries of `priors:` beside a posterior that hands on the prior of the same parameter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from tests.shared.priors import EVERYTHING
from tests.shared.study_folders import make_folder, replace_in

from deabayes.checks.prior_sources import Sources
from deabayes.checks.priors import overruled
from deabayes.faults import UserError
from deabayes.pipeline import fit
from deabayes.posteriors.inheritance import Inheritance
from deabayes.prior.from_posterior import PriorFromPosterior
from deabayes.prior.joint import Prior
from deabayes.records.specimen import read_specimen
from deabayes.studies import load_studies
from deabayes.study import Study
from deabayes.systems import build

SOURCE = "results/first/kv_gm_1/posterior.nc"
MU = {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}
SAME = {"distribution": "lognormal", "median": "35000 Pa", "sigma": 0.5}
OTHER = MU | {"sigma": 0.1}
TAU = {"distribution": "loguniform", "lower": "1 s", "upper": "100 s"}


def said(tmp_path: Path, own: dict[str, object], theirs: dict[str, object]) -> list[str]:
    """Of a study with the priors `own` and all material parameters handed on."""
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), priors=own, prior_from=SOURCE)
    specimen = read_specimen(study.specimen)
    system = build("tensile_strip", "kv_gm_1", specimen)
    names = [p.name for p in system.parameters() if p.name not in specimen.quantities]
    return overruled(study, system, names, theirs)


@pytest.mark.parametrize(
    ("own", "theirs"),
    [
        ({"mu_alpha": MU}, {"mu_alpha": SAME}),
        ({"tau_beta": TAU}, {"tau_beta": TAU, "mu_alpha": MU}),
        ({"sigma_ou": MU}, {}),
        ({"cross_section": {"distribution": "normal", "mean": "20 mm^2", "sd": "1 mm^2"}}, {}),
        ({}, {"mu_alpha": MU}),
    ],
)
def test_the_entry_of_the_fit_and_what_is_not_handed_on_are_no_matter(
    tmp_path: Path, own: dict[str, object], theirs: dict[str, object]
) -> None:
    assert said(tmp_path, own, theirs) == []


@pytest.mark.parametrize(
    ("own", "theirs", "names"),
    [
        ({"mu_alpha": OTHER}, {}, "priors.mu_alpha: mu_alpha has its prior from"),
        ({"mu_alpha": OTHER}, {"mu_alpha": MU}, "priors.mu_alpha: mu_alpha has its"),
        ({"mu_alpha": MU}, {"mu_alpha": MU | {"median": "35 s"}}, "priors.mu_alpha: "),
        (
            {"tau_beta": TAU},
            {"tau_beta": TAU | {"minimum_ratio": 3}},
            "priors.tau_beta: tau_beta_1",
        ),
    ],
)
def test_any_other_is_named(
    tmp_path: Path, own: dict[str, object], theirs: dict[str, object], names: str
) -> None:
    (line,) = said(tmp_path, own, theirs)
    assert line.startswith(names)
    assert f"from {SOURCE} (prior_from), not from this entry, which only bounds it" in line


def test_several_parameters_of_one_entry(tmp_path: Path) -> None:
    study = Study("s", make_folder(tmp_path), ("kv_gm_2",), priors={"tau_beta": TAU})
    system = build("tensile_strip", "kv_gm_2", read_specimen(study.specimen))
    (line,) = overruled(study, system, ["tau_beta_1", "tau_beta_2"], {})
    assert "tau_beta_1, tau_beta_2 have their priors from" in line


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        ({"mu_alpha": MU}, {"mu_alpha": SAME}, []),
        ({"mu_alpha": MU}, {"mu_alpha": OTHER}, ["mu_alpha"]),
        ({}, {"cross_section": {"distribution": "normal", "mean": "20 mm^2", "sd": "1 mm^2"}}, []),
    ],
)
def test_a_posterior_that_is_still_to_come(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    first: dict[str, object],
    second: dict[str, object],
    named: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    make_folder(tmp_path).rename("one")
    replace_in(make_folder(tmp_path) / "specimen.yaml", "strip A", "strip B")
    studies = {
        "first": {"specimen": "one", "candidates": ["kv_gm_1"], "priors": first},
        "second": {"specimen": "strip", "candidates": ["kv_gm_1"], "priors": second},
    }
    studies["second"]["prior_from"] = SOURCE
    Path("config.yaml").write_text(yaml.safe_dump({"studies": studies}))
    read = {each.name: each for each in load_studies(Path("config.yaml"))}
    lines = Sources(read, {}).cautions(read["second"])
    assert [line.split(":")[0] for line in lines] == [f"study second, priors.{n}" for n in named]
    assert Sources(read, {}).cautions(read["first"]) == []


def test_a_posterior_that_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handed_on = PriorFromPosterior(("mu_alpha",), np.empty((0, 1)))
    found = Inheritance(handed_on, True, priors={"mu_alpha": MU})
    monkeypatch.setattr("deabayes.checks.prior_sources.inherit_from", lambda *_: found)
    (tmp_path / "posterior.nc").touch()
    source = str(tmp_path / "posterior.nc")
    study = Study("s", make_folder(tmp_path), ("kv_gm_1", "kv_gm_2"), prior_from=source)
    assert Sources({}, {}).cautions(replace(study, priors={"mu_alpha": SAME})) == []
    (line,) = Sources({}, {}).cautions(replace(study, priors={"mu_alpha": OTHER}))
    assert line.startswith(f"study s, priors.mu_alpha: mu_alpha has its prior from {source}")


def test_the_fit_says_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handed_on = PriorFromPosterior(("mu_alpha",), np.empty((0, 1)))
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), priors={"mu_alpha": OTHER})
    system = build("tensile_strip", "kv_gm_1", read_specimen(study.specimen))
    target = SimpleNamespace(system=system, records=(), names=("mu_alpha",))
    found = Inheritance(handed_on, True, ("prior_from: n",))
    monkeypatch.setattr(fit, "inherited_prior", lambda *_: found)
    monkeypatch.setattr("deabayes.inference.default_priors.further_prior", lambda *_: None)
    monkeypatch.setattr(
        "deabayes.posteriors.content.PosteriorContent.of", lambda *given: given[6].notes
    )
    first, second = fit._content(study, "kv_gm_1", target, None)
    assert first == "prior_from: n" and second.startswith("priors.mu_alpha: mu_alpha has its")


def test_draws_at_the_rim_of_a_prior_are_refused() -> None:
    draws = np.exp(np.random.default_rng(1).normal(size=(500, 1)))
    prior = Prior.from_parameters(
        EVERYTHING,
        {"zeta_alpha": {"distribution": "lognormal", "median": 1.0, "sigma": 0.1}},
    )
    assert prior.inherit(("zeta_alpha",), np.clip(draws, 0.06, 19.0)).inherited
    with pytest.raises(UserError, match=r"1 of 500 draws of zeta_alpha are more than 30 standard"):
        prior.inherit(("zeta_alpha",), np.append(np.clip(draws[1:], 0.06, 19.0), [[25.0]], axis=0))
