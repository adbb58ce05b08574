"""`prior_from`: what it names must be there, come first, and fit every candidate."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.shared.study_folders import make_folder

from deabayes.checks.prior_sources import Sources
from deabayes.cli.main import main
from deabayes.population.settings import load_populations
from deabayes.posteriors.inheritance import Inheritance
from deabayes.prior.from_posterior import PriorFromPosterior
from deabayes.studies import load_studies

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_folder(tmp_path)
    shutil.copytree(ROOT / "data" / "tubular", tmp_path / "tube")
    (tmp_path / "fitted" / "kv_gm_2").mkdir(parents=True)
    (tmp_path / "fitted" / "kv_gm_2" / "posterior.nc").touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def faults(entries: dict[str, str | None], populations: object = None, **sources: object) -> str:
    """What is said of studies a, b, ... of a strip, each with its `prior_from`."""
    strip = {"specimen": "strip", "candidates": ["kv_gm_2"]}
    studies: dict[str, object] = {n: strip | {"prior_from": p} for n, p in entries.items()}
    if "a" in studies:  # not on what the others are calibrated on
        studies["a"] |= {"calibrate": ["pull"], "validate": []}
    studies["tube"] = {"specimen": "tube", "candidates": ["voigt_kelvin_1"]}
    studies["less"] = {"specimen": "strip", "candidates": ["kv_gm_1"]}
    Path("config.yaml").write_text(yaml.safe_dump({"studies": studies, "populations": populations}))
    read = {each.name: each for each in load_studies(Path("config.yaml"))}
    found = Sources(read, {p.name: p for p in load_populations(Path("config.yaml"))}, **sources)
    every = [fault for study in read.values() for fault in found.faults(study)]
    return "\n".join(dict.fromkeys(every))


@pytest.mark.parametrize("spelt", ["{}", "./{}", "strip/../{}", "{here}/{}"])
def test_a_study_of_the_same_config_however_spelt(place: Path, spelt: str) -> None:
    source = spelt.format("results/b/kv_gm_2/posterior.nc", here=place)
    assert faults({"a": source, "b": None}) == ""
    study = load_studies(Path("config.yaml"))[0]
    assert study.prior_from == "results/b/kv_gm_2/posterior.nc"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("results/bb/kv_gm_2/posterior.nc", "'bb' is no study; did you mean 'b'?"),
        ("results/b/kv_gm_3/posterior.nc", "study 'b' has no candidate 'kv_gm_3'; did you mean"),
        ("results/b/kv_gm_2/posterir.nc", "there is no such file"),
        ("elsewhere/posterior.nc", "there is no such file"),
        ("strip", "strip: is a folder without a posterior.nc"),
        ("fitted", "fitted: is a folder; give fitted/kv_gm_2/posterior.nc"),
        ("results/populations/strips/posterior.nc", "'strips' is no population"),
        (
            "results/less/kv_gm_1/posterior.nc",
            "kv_gm_2, prior_from: the posterior lacks tau_beta_2",
        ),
        (
            "results/tube/voigt_kelvin_1/posterior.nc",
            "none of the posterior's parameters (E_0, E_1",
        ),
        ("results/away/kv_gm_2/posterior.nc", "study 'away' is left out"),
        ("config.yaml", "prior_from: config.yaml: not a readable netCDF file"),
    ],
)
def test_what_cannot_be_a_prior_is_one_sentence(place: Path, source: str, said: str) -> None:
    found = faults({"a": source, "b": None}, left_out=["away"])
    assert said in found and found.startswith("study a, ")
    assert found.count("\n") == 0


def test_studies_that_are_priors_of_one_another_are_refused(place: Path) -> None:
    found = faults({n: f"results/{m}/kv_gm_2/posterior.nc" for n, m in ("ab", "bc", "ca", "da")})
    assert found.count("its own prior") == 1
    assert found.startswith("prior_from: a from b, b from c, c from a: ")
    assert "a from a" in faults({"a": "results/a/kv_gm_2/posterior.nc"})


def test_a_circle_through_a_population(place: Path) -> None:
    population = {"studies": ["b", "c", "d"], "candidate": "kv_gm_2", "parameters": ["mu_alpha"]}
    source = "results/populations/all/posterior.nc"
    ring = {"a": source, "b": "results/a/kv_gm_2/posterior.nc", "c": None, "d": None}
    found = faults(ring, {"all": population})
    assert "a from populations/all, populations/all from b, b from a: " in found


def test_other_results_folders(place: Path) -> None:
    source = "results/quick/b/kv_gm_2/posterior.nc"
    assert faults({"a": source, "b": None}, results=Path("results/quick")) == ""
    assert "there is no such file" in faults({"a": source, "b": None})


def test_check_reports_notes_and_doubts_of_a_posterior(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Inheritance(PriorFromPosterior((), np.empty((0, 0))), True, ("prior_from: n",), ("d",))
    monkeypatch.setattr("deabayes.checks.prior_sources.inherit_from", lambda *_: found)
    monkeypatch.setattr(Sources, "faults", lambda *_: [])
    Path("posterior.nc").touch()
    faults({"a": "posterior.nc"})
    main(("check", "a"))
    said = capsys.readouterr().out
    assert "warnings on study a" in said
    assert "  - study a, prior_from: d\n  - study a, prior_from: n\n" in said


def test_check_reports_a_missing_study(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    faults({"a": "results/bb/kv_gm_2/posterior.nc", "b": None})
    with pytest.raises(SystemExit):
        main(("check", "a"))
    assert "'bb' is no study; did you mean 'b'?" in capsys.readouterr().err
    main(("check", "b"))
