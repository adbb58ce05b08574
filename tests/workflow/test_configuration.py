"""What a config file says, to `snakemake` as to the command line; mistakes are one message."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder, replace_in
from tests.workflow.snakemake_runs import snakemake

from deabayes.faults import UserError
from deabayes.records.schema import read_yaml

SOUND = """\
studies:
  a: &a
    specimen: strip
    candidates: [kv_gm_1]
  b:
    <<: *a
    candidates: [kv_gm_2]
sampling: {ensembles: 3.0, ess: 1e3, walkers: 24}
"""
PLAN = ("--cores", "1", "--dry-run", "--printshellcmds")
"""Settings are in the commands of the jobs that write them."""
WRITTEN = 4
"""How often: in study.yaml of two studies, and in settings.yaml of one candidate of each."""


def said(folder: Path, *arguments: str) -> str:
    """What a dry run that cannot be started says."""
    run = snakemake(folder, "--cores", "1", "--dry-run", "--quiet", *arguments)
    assert run.returncode == 1, run.stdout
    assert "Traceback" not in run.stderr
    return run.stderr


def test_an_own_file_is_read_as_the_library_reads_it(tmp_path: Path) -> None:
    """Numbers, merge keys, and the key that moves the results."""
    make_folder(tmp_path)
    (tmp_path / "mine.yaml").write_text(f"pathvars: {{results: out}}\n{SOUND}")
    run = snakemake(tmp_path, *PLAN, "--configfile", tmp_path / "mine.yaml")
    assert run.returncode == 0 and "without studies" not in run.stderr, run.stderr
    for file in ("a/kv_gm_1/posterior.nc", "b/kv_gm_2/posterior.nc"):
        assert f"out/{file}" in run.stdout
    assert run.stdout.count("  ensembles: 3\n") == run.stdout.count("  ess: 1000.0\n") == WRITTEN


def test_settings_are_laid_over_the_shipped_file(tmp_path: Path) -> None:
    make_folder(tmp_path)
    (tmp_path / "config.yaml").write_text(SOUND)
    (tmp_path / "fewer.yaml").write_text("sampling: {ensembles: 2}")
    given = ("--config", "data_root=elsewhere", "--configfile", tmp_path / "fewer.yaml")
    run = snakemake(tmp_path, *PLAN, *given)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("  ensembles: 2\n") == run.stdout.count("  ess: 1000.0\n") == WRITTEN
    assert "  ensembles: 3\n" not in run.stdout
    laid_over = "fewer.yaml: without studies of its own; every study of config.yaml is run"
    assert run.stderr.count(laid_over) == 1


def test_unknown_keys_are_a_mistake_wherever_they_are_given(tmp_path: Path) -> None:
    make_folder(tmp_path)
    (tmp_path / "config.yaml").write_text(f"pathvars: {{result: out}}\n{SOUND}")
    wrong = said(tmp_path, "--config", "data_rot=elsewhere")
    assert "unknown key 'data_rot'; did you mean 'data_root'?" in wrong
    assert "pathvars: unknown key 'result'; did you mean 'results'?" in wrong


@pytest.mark.parametrize("name", ["config.yaml", "mine.yaml"])
def test_two_studies_of_one_name_are_a_mistake(tmp_path: Path, name: str) -> None:
    make_folder(tmp_path)
    (tmp_path / name).write_text(SOUND.replace("  b:", "  a:"))
    given = () if name == "config.yaml" else ("--configfile", str(tmp_path / name))
    error = said(tmp_path, *given)
    assert f"{name}, line 5: key 'a' is given twice" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SOUND.replace("    specimen", "   specimen", 1), "config.yaml, line 4: "),
        (SOUND.replace("    specimen", "\t  specimen", 1), "config.yaml, line 3: "),
        ("", "config.yaml: expected `key: value` lines, found nothing"),
    ],
    ids=["indent", "tab", "empty"],
)
def test_what_cannot_be_read_is_named_by_file_and_line(
    tmp_path: Path, text: str, words: str
) -> None:
    """The workflow reads its files by the same function."""
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(UserError) as raised:
        read_yaml(tmp_path / "config.yaml")
    error = str(raised.value).removeprefix(f"{tmp_path}/")
    assert error.startswith(words) and error.count("\n") == 0


def test_a_prior_from_nowhere_is_said_before_any_job(tmp_path: Path) -> None:
    make_folder(tmp_path)
    there = "results/b/kv_gm_2/posterior.nc"
    (tmp_path / "config.yaml").write_text(SOUND.replace("  b:", f"    prior_from: ./{there}\n  b:"))
    error = said(tmp_path)
    assert "study a, kv_gm_1, prior_from: the posterior has" in error
    assert "prior_from: b from b: " in error, "the merge key hands it on"
    text = SOUND.replace("kv_gm_1", "kv_gm_2").replace("  b:", f"    prior_from: ./{there}\n  b:")
    text = text.replace("    <<: *a\n", "    specimen: strip\n")
    other = text.replace("  b:\n", "  b:\n    calibrate: [pull]\n    validate: []\n")
    (tmp_path / "config.yaml").write_text(other)
    run = snakemake(tmp_path, "--cores", "1", "--dry-run")
    assert run.returncode == 0, run.stderr


def test_a_record_that_is_not_there_is_named_as_check_names_it(tmp_path: Path) -> None:
    table = make_folder(tmp_path) / "experiments.csv"
    replace_in(table, "records/pull.csv", "records/pul.csv")
    (tmp_path / "config.yaml").write_text(SOUND)
    error = said(tmp_path)
    assert "pul.csv (pull): there is no such file" in error
    assert "did you mean 'records/pull.csv'?" in error and error.count("\n") == 1


@pytest.mark.parametrize("name", ["strip/specimen.yaml", "strip/experiments.csv", "config.yaml"])
def test_a_file_that_may_not_be_read(tmp_path: Path, name: str) -> None:
    make_folder(tmp_path)
    (tmp_path / "config.yaml").write_text(SOUND)
    (tmp_path / name).chmod(0)
    if os.access(tmp_path / name, os.R_OK):
        pytest.skip("whoever runs this may read everything")
    error = said(tmp_path)
    assert f"{name}: Permission denied" in error and error.count("\n") == 1
