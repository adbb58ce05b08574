"""config.yaml and study.yaml: what is read, split, refused and written back."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from tests.shared.study_folders import make_config, replace_in

from deabayes.faults import Faults, UserError
from deabayes.studies import load_studies, load_study, write_study
from deabayes.study import (
    Sampling,
    Study,
    fit_settings,
    from_settings,
    settings_on_file,
    to_settings,
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return make_config(tmp_path)


def test_a_study_with_everything(config: Path) -> None:
    (study,) = load_studies(config)
    assert study.name == "vhb"
    assert study.specimen == config.parent / "strip"
    assert study.data_root == config.parent.parent / "public"
    assert study.candidates == ("kv_gm_1", "kv_gm_2")
    assert study.calibrate == ("relax",)
    assert study.noise == "ornstein_uhlenbeck"
    assert study.noise_scale == "range"
    assert study.preparation["relaxation"][0] == {"mask_before": {"time": "0.1 s"}}
    assert study.priors["mu_alpha"]["median"] == "35 kPa"
    assert study.sampling == Sampling(ensembles=2, walkers=64, seed=7, r_hat=1.02)


def test_settings_go_round_through_json_and_yaml(config: Path, tmp_path: Path) -> None:
    (study,) = load_studies(config)
    assert from_settings(json.loads(json.dumps(to_settings(study)))) == study
    path = tmp_path / "results" / "vhb" / "study.yaml"
    write_study(study, path)
    assert load_study(path) == study


def test_fit_settings_leave_out_what_no_fit_depends_on(config: Path) -> None:
    (study,) = load_studies(config)
    assert study.further_experiments == {"longer": {"like": "relax", "duration": 2}}
    assert study.evidence_check == "nested"
    left = {*to_settings(study)} - {*settings_on_file(study)}
    assert left == {"further_experiments", "evidence_check"}
    asked_nothing = from_settings(settings_on_file(study))
    assert fit_settings(asked_nothing) == fit_settings(study)
    others = replace(study, candidates=("kv_gm_4",), validate=())
    assert others != study and fit_settings(others) == fit_settings(study)


def test_json_written_by_hand_is_a_study_file(config: Path, tmp_path: Path) -> None:
    (study,) = load_studies(config)
    path = tmp_path / "study.yaml"
    path.write_text(json.dumps(to_settings(study), indent=1))
    assert load_study(path) == study


def test_unchanged_settings_leave_the_file_alone(config: Path, tmp_path: Path) -> None:
    (study,) = load_studies(config)
    path = tmp_path / "study.yaml"
    write_study(study, path)
    os.utime(path, (1, 1))
    write_study(study, path)
    assert path.stat().st_mtime == 1
    write_study(from_settings({**to_settings(study), "noise": "white"}), path)
    assert path.stat().st_mtime > 1
    assert load_study(path).noise == "white"
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_one_study_of_a_config_by_name(config: Path) -> None:
    assert load_study(config, "vhb").name == "vhb"
    assert load_study(config).name == "vhb"
    with pytest.raises(UserError, match=r"has no study 'vbh'; did you mean 'vhb'\?"):
        load_study(config, "vbh")


def test_of_several_studies_one_must_be_named(config: Path) -> None:
    other = "studies:\n  other: {specimen: strip, candidates: [kv_gm_1]}\n"
    replace_in(config, "studies:\n", other)
    with pytest.raises(UserError, match="has several studies; name one of other, vhb"):
        load_study(config)
    assert load_study(config, "other").name == "other"


def test_a_mapping_is_read_like_its_file(config: Path) -> None:
    from deabayes.records.schema import read_yaml

    assert load_studies(read_yaml(config), str(config)) == load_studies(config)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("    candidates: [kv_gm_1, kv_gm_2]\n", "", ["studies.vhb", "'candidates' is missing"]),
        ("specimen: strip", "specimens: strip", ["unknown key 'specimens'", "'specimen'?"]),
        ("sampling: {ens", "samplings: {ens", ["unknown key 'samplings'", "'sampling'?"]),
        ("candidates: [kv_gm_1, kv_gm_2]", "candidates: kv_gm_1", ["expected a list", "kv_gm_1"]),
        ("candidates: [kv_gm_1, kv_gm_2]", "candidates: []", ["at least 1"]),
        ("noise_scale: range", "noise_scale: rang", ["noise_scale", "did you mean 'range'"]),
        ("ensembles: 2", "ensembles: 0", ["sampling.ensembles", ">= 2", "found 0"]),
        ("ensembles: 2", "ensembles: two", ["sampling.ensembles", "a whole number", "'two'"]),
        ("walkers: 64", "walkers: 33", ["studies.vhb.sampling.walkers", "a multiple of 2", "33"]),
        ("r_hat: 1.02", "r_hat: 0.9", ["sampling.r_hat", "> 1", "0.9"]),
        ("seed: 7", "sed: 7", ["sampling", "unknown key 'sed'", "'seed'?"]),
        ("load_unload: [", "loading: [", ["preparation", "'loading'"]),
        ("[{mask_before: {time: 0.1 s}}, {", "[{mask_before: {time: 1}, ", ["single key"]),
        ("distribution: lognormal", "dist: lognormal", ["'distribution' is missing"]),
        ("validate: [pull]", "validate: [relax]", ["relax", "calibrate and under validate"]),
        ("  vhb:", "  v/b:", ["'v/b'"]),
        ("duration: 2", "duration: 0.5", ["further_experiments.longer.duration", "> 1", "0.5"]),
        ("duration: 2", "durations: 2", ["unknown key 'durations'", "'duration'?"]),
        ("{like: relax, ", "{", ["further_experiments.longer", "'like' is missing"]),
        ("evidence_check: nested", "evidence_check: nestd", ["evidence_check", "'nested'"]),
        ("data_root:", "data_rot:", ["unknown key 'data_rot'", "'data_root'?"]),
    ],
)
def test_faults_name_the_key_and_the_remedy(
    config: Path, old: str, new: str, words: list[str]
) -> None:
    replace_in(config, old, new)
    with pytest.raises(UserError) as caught:
        load_studies(config)
    for word in ["config.yaml", *words]:
        assert word in str(caught.value)


def test_all_faults_come_together(config: Path) -> None:
    replace_in(config, "noise_scale: range", "noise_scale: rang")
    replace_in(config, "seed: 7", "seed: -7")
    with pytest.raises(Faults) as caught:
        load_studies(config)
    assert len(caught.value.faults) == 2


def test_faults_of_a_study_file(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("name: a\nspecimen: b\ncandidates: [gent]\nnoize: white\n")
    with pytest.raises(Faults, match=r"study\.yaml, studies\.a: unknown key 'noize'.*'noise'"):
        load_study(path)


def test_a_study_file_is_not_split(config: Path, tmp_path: Path) -> None:
    """It was read as one study of all parts."""
    (study,) = load_studies(config)
    path = tmp_path / "study.yaml"
    path.write_text(json.dumps({**to_settings(study), "split_by": "protocol"}))
    with pytest.raises(UserError, match=r"study\.yaml, split_by: .*`studies: \{vhb: .*`select: "):
        load_study(path)
    path.write_text(json.dumps({**to_settings(study), "split_by": None}))
    assert load_study(path) == study


def test_two_studies_of_one_name(config: Path) -> None:
    entry = "{specimen: strip, candidates: [gent]}"
    config.write_text(f"studies: {{a: {entry}, A: {entry}}}")
    with pytest.raises(UserError, match="two studies are called 'A'"):
        load_studies(config)


def test_defaults_are_the_contract() -> None:
    study = Study("a", Path("a"), ("gent",))
    assert to_settings(study)["sampling"] == {
        "ensembles": 4, "walkers": 32, "max_steps": 20000, "ess": 400.0, "r_hat": 1.01,
        "autocorrelation_times": 10.0, "particles": 512, "seed": 1,
    }  # fmt: skip
