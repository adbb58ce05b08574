"""A study and a candidate that fail: the rest is finished, and the report names them."""

from __future__ import annotations

import csv
import os
import re
import shutil
import signal
import time
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from tests.shared.own_model_page import write_page
from tests.shared.study_folders import replace_in
from tests.workflow.snakemake_runs import snakemake, started

FAILS = """
import sys
from pathlib import Path

if {"fit", "lag_1"} <= set(sys.argv) and Path("fail").exists():
    sys.exit("no memory left")
"""
CONFIG = """
  broken:
    specimen: data/broken
    candidates: [lag_0]
    preparation: {creep: []}
  after:
    specimen: data/stack
    candidates: [lag_0]
    calibrate: [creep_1500V]
    validate: []
    preparation: {creep: []}
    prior_from: results/broken/lag_0/posterior.nc
sampling: {ensembles: 2, walkers: 24, max_steps: 60, particles: 64, seed: 1}
"""
RECORD = Path("data/broken/records/creep_1000V.csv")
PAGE = Path("results/report/index.html")
FIT = "results/stack/lag_1/logs/fit.log"


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CompletedProcess[str]]:
    """A whole run: of `stack` one candidate fails, of `broken` a record lacks a column."""
    place = write_page(tmp_path_factory.mktemp("failures"))
    with (place / "models" / "stack.py").open("a") as model:
        model.write(FAILS)
    with (place / "config.yaml").open("a") as config:
        config.write(CONFIG)
    shutil.copytree(place / "data" / "stack", place / "data" / "broken")
    replace_in(place / RECORD, "displacement [m]", "nothing [m]")
    (place / "fail").touch()
    return place, snakemake(place, "--cores", "2")


def planned(place: Path, *arguments: str) -> set[str]:
    """The jobs that would run now: rule, and study and candidate where it has them."""
    run = snakemake(place, "--cores", "1", "--dry-run", *arguments)
    assert run.returncode == 0, run.stderr
    blocks = re.findall(r"^(?:local)?rule (\w+):\n((?:    .*\n)+)", run.stdout, re.MULTILINE)
    names = (re.findall(r"(?:study|candidate)=(\w+)", block) for _, block in blocks)
    return {" ".join([rule, *found]) for (rule, _), found in zip(blocks, names, strict=True)}


def test_the_run_ends_with_an_error_and_short_lines(failed: tuple[Path, CompletedProcess]) -> None:
    _, run = failed
    assert run.returncode == 1 and run.stdout.startswith("Report: ")
    lines = run.stderr.splitlines()
    assert max(map(len, lines)) < 250 and len(run.stderr) < 10_000
    assert any(re.search(rf"FAILED +fit stack lag_1 +{FIT}", line) for line in lines)
    assert f"Failed: fit stack lag_1 {FIT}" in lines
    assert any(re.search(r"done +fit stack lag_0 +\d+ of \d+ jobs", line) for line in lines)
    assert any("column 'displacement' is missing" in line for line in lines)


def test_the_report_names_what_failed_above_and_with_its_study(
    failed: tuple[Path, CompletedProcess],
) -> None:
    text = (failed[0] / PAGE).read_text()
    above, stack = text.index('id="failed"'), text.index('<section id="stack">')
    for words in (FIT, "no memory left", "results/broken/logs/prepare.log", "column &#39;displ"):
        assert above < text.index(words) < stack
    assert FIT in text[stack : text.index('<section id="after">')]
    broken = text[text.index('<section id="broken">') :]
    assert "No results" in broken and "results/broken/logs/prepare.log" in broken
    assert "it needs results of what failed elsewhere" in text[text.index('<section id="after">') :]


def test_other_candidates_are_compared_and_shown(failed: tuple[Path, CompletedProcess]) -> None:
    tables = failed[0] / PAGE.parent / "tables"
    for kind in ("comparison", "errors"):
        with (tables / f"stack_{kind}.csv").open(newline="") as stream:
            assert {row["candidate"] for row in csv.DictReader(stream)} == {"lag_0"}
    assert "Parameters of lag_0" in (failed[0] / PAGE).read_text()


def test_nothing_is_taken_for_complete(failed: tuple[Path, CompletedProcess]) -> None:
    """Neither with what failed in the study, nor without it."""
    place, _ = failed
    assert not (place / "results/stack/comparison.csv").exists()
    missing = {"compare stack", "figures stack", "report", "analyse stack"}
    assert planned(place) >= missing | {"fit stack lag_1", "prepare broken", "fit after lag_0"}
    config = (place / "config.yaml").read_text()
    without = config[: config.index("  broken:")] + config[config.index("sampling:") :]
    (place / "less.yaml").write_text(without.replace("[lag_0, lag_1]", "[lag_0]"))
    assert planned(place, "--configfile", str(place / "less.yaml")) >= missing


def test_after_an_interruption_no_report_is_built(failed: tuple[Path, CompletedProcess]) -> None:
    """Also where a job had failed before; the others were still to be run."""
    place = failed[0].with_name("interrupted0")
    shutil.copytree(failed[0], place, symlinks=True)
    (place / "fail").unlink()
    replace_in(place / "config.yaml", "max_steps: 60", "ess: 1e9, max_steps: 600000")
    with started(place, "--cores", "2") as run:
        said = iter(run.stderr.readline, "")
        assert any("FAILED  prepare broken" in line for line in said)
        time.sleep(2.0)  # until Snakemake has taken note of it
        os.killpg(run.pid, signal.SIGINT)
        rest = run.stderr.read()
    assert run.returncode == 1 and "Failed: prepare broken" in rest
    assert "The report is built" not in rest


def test_a_later_run_builds_the_whole_report(failed: tuple[Path, CompletedProcess]) -> None:
    place = failed[0].with_name("mended0")  # as deep as the other: paths to src/ stay the same
    shutil.copytree(failed[0], place, symlinks=True)
    (place / "fail").unlink()
    replace_in(place / RECORD, "nothing [m]", "displacement [m]")
    config = (place / "config.yaml").read_text()
    without = config[: config.index("  after:")] + config[config.index("sampling:") :]
    (place / "config.yaml").write_text(without)
    run = snakemake(place, "--cores", "2")
    assert run.returncode == 0, run.stderr
    text = (place / PAGE).read_text()
    assert "did not finish" not in text and "Parameters of lag_1" in text
    assert not (place / "results/logs/unfinished").exists()
    again = snakemake(place, "--cores", "2")
    assert again.returncode == 0 and "Nothing to be done" in again.stderr
