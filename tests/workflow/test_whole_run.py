"""The page on models of one's own, run to its report: first with failures, then mended.

A study and a candidate fail. The rest is finished, and the report names what failed. After they
are mended, a second run completes the results, which are those of any study.
"""

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
from tests.workflow.snakemake_runs import STUB, planned, snakemake, started, write_stub

import deabayes
from deabayes.cli.main import main

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
RESULTS = Path("results/stack")
PAGE = Path("results/report/index.html")
FIT = "results/stack/lag_1/logs/fit.log"
LOGS = ("results/broken/logs/prepare/creep_1000V.log", "results/broken/logs/check.log")


def write_studies(place: Path) -> Path:
    """The page's study, one whose record lacks a column, one that needs the latter's posterior."""
    write_page(place)
    with (place / "config.yaml").open("a") as config:
        config.write(CONFIG)
    shutil.copytree(place / "data" / "stack", place / "data" / "broken")
    replace_in(place / RECORD, "displacement [m]", "nothing [m]")
    return place


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CompletedProcess[str]]:
    """A whole run in which one candidate of `stack` fails, and all of `broken`."""
    place = write_studies(tmp_path_factory.mktemp("failures"))
    with (place / "models" / "stack.py").open("a") as model:
        model.write(FAILS)
    (place / "fail").touch()
    return place, snakemake(place, "--cores", "2")


@pytest.fixture(scope="module")
def mended(failed: tuple[Path, CompletedProcess[str]]) -> Path:
    """The run after the cause of the candidate's failure is gone, without the other studies."""
    place = failed[0].with_name("mended0")
    shutil.copytree(failed[0], place, symlinks=True)
    (place / "fail").unlink()
    config = (place / "config.yaml").read_text()
    only_stack = config[: config.index("  broken:")] + config[config.index("sampling:") :]
    (place / "config.yaml").write_text(only_stack)
    run = snakemake(place, "--cores", "2")
    logs = "\n".join(path.read_text() for path in place.rglob("*.log") if path.stat().st_size)
    assert run.returncode == 0, run.stderr + logs
    return place


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_run_ends_with_an_error_and_short_lines(failed: tuple[Path, CompletedProcess]) -> None:
    _, run = failed
    assert run.returncode == 1 and run.stdout.startswith("Report: ")
    lines = run.stderr.splitlines()
    assert max(map(len, lines)) < 250 and len(run.stderr) < 10_000
    assert any(re.search(rf"FAILED +fit stack lag_1 +{FIT}", line) for line in lines)
    assert f"Failed: fit stack lag_1 {FIT}" in lines
    assert f"Failed: prepare broken creep_1000V {LOGS[0]}" in lines
    assert f"Failed: check broken {LOGS[1]}" in lines
    assert any(re.search(r"done +fit stack lag_0 +\d+ of \d+ jobs", line) for line in lines)
    assert any("no column is displacement" in line for line in lines)


def test_the_report_names_what_failed_above_and_with_its_study(
    failed: tuple[Path, CompletedProcess],
) -> None:
    text = (failed[0] / PAGE).read_text()
    above, stack = text.index('id="failed"'), text.index('<section id="stack">')
    for words in (
        FIT,
        "no memory left",
        *LOGS,
        "no column is displacement",
        "Failed: prepare creep_1000V",
    ):
        assert above < text.index(words) < stack
    assert FIT in text[stack : text.index('<section id="after">')]
    broken = text[text.index('<section id="broken">') :]
    assert "No results" in broken and LOGS[0] in broken
    assert "it needs results of what failed elsewhere" in text[text.index('<section id="after">') :]


def test_other_candidates_are_compared_and_shown(failed: tuple[Path, CompletedProcess]) -> None:
    tables = failed[0] / PAGE.parent / "tables"
    for kind in ("comparison", "errors"):
        assert {row["candidate"] for row in rows(tables / f"stack_{kind}.csv")} == {"lag_0"}
    assert "Parameters of lag_0" in (failed[0] / PAGE).read_text()


def test_nothing_is_taken_for_complete(failed: tuple[Path, CompletedProcess]) -> None:
    """Neither with what failed in the study, nor without it."""
    place, _ = failed
    assert not (place / "results/stack/comparison.csv").exists()
    missing = {"compare stack", "figures stack", "report", "analyse stack"}
    assert planned(place) >= missing | {
        "fit stack lag_1", "check broken", "prepare broken creep_1000V", "fit after lag_0",
    }  # fmt: skip
    config = (place / "config.yaml").read_text()
    without = config[: config.index("  broken:")] + config[config.index("sampling:") :]
    (place / "less.yaml").write_text(without.replace("[lag_0, lag_1]", "[lag_0]"))
    assert planned(place, "--configfile", place / "less.yaml") >= missing


def test_after_an_interruption_no_report_is_built(tmp_path: Path) -> None:
    """Also where a job had failed before; the others were still to be run."""
    place = write_studies(tmp_path)
    stub = "#!/bin/sh\ncase $* in *broken*) exit 1;; fit*) exec sleep 300;; esac\n"
    write_stub(place, stub + STUB.removeprefix("#!/bin/sh\n"))
    with started(place, "--cores", "2") as run:
        said = iter(run.stderr.readline, "")
        assert any("FAILED  prepare broken" in line for line in said)
        assert any("begins  fit stack" in line for line in said)
        time.sleep(1.0)  # until Snakemake has taken note of the failure
        os.killpg(run.pid, signal.SIGINT)
        rest = run.stderr.read()
    assert run.returncode == 1 and "Failed: prepare broken" in rest
    assert "The report is built" not in rest


def test_a_later_run_builds_the_whole_report(mended: Path) -> None:
    text = (mended / PAGE).read_text()
    assert "did not finish" not in text and "Parameters of lag_1" in text
    assert not (mended / "results/logs/unfinished").exists()
    assert planned(mended) == set()


def test_from_records_to_report(mended: Path) -> None:
    page, results = (mended / PAGE).read_text(), mended / RESULTS
    for text in ("stack A", "lag_0", "lag_1", "not converge"):
        assert text in page
    found = {(row["candidate"], row["order"]) for row in rows(results / "comparison.csv")}
    assert found == {("lag_0", "0"), ("lag_1", "1")}
    roles = {row["experiment"]: row["role"] for row in rows(results / "lag_1" / "errors.csv")}
    assert roles == {"creep_1000V": "calibrate", "creep_1500V": "validate"}
    summary = rows(results / "lag_1" / "summary.csv")
    assert {row["converged"].lower() for row in summary} == {"false"}
    assert (results / "lag_1" / "predictions" / "creep_1500V.nc").is_file()
    assert (results / "analyses" / "index.json").is_file()
    assert list((results / "figures").glob("*.svg"))
    further = (results / "further_experiments.csv").read_text()
    assert further.startswith("experiment,what,")
    assert len(further.splitlines()) == 1, "nothing is planned with what did not converge"


def test_a_posterior_knows_its_own_model(
    mended: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(mended)
    posterior = RESULTS / "lag_1" / "posterior.nc"
    post = deabayes.open_posterior(posterior)
    assert post.data.attrs["model_file"] == "models/stack.py"
    assert {"Y", "tau", "thickness"} <= set(post.names)
    band = post.predict(time=[0.0, 0.5], voltage=[1000.0, 1000.0])
    assert float(band["median"][-1]) == pytest.approx(8.9e-5, rel=0.2)
    main(("export", str(posterior), "--to", "csv", "-o", str(tmp_path / "draws.csv")))
    assert "Y" in (tmp_path / "draws.csv").read_text().splitlines()[0]
    again = tmp_path / "again"
    main(("predict", str(posterior), "-o", str(again), "--errors", str(again / "errors.csv")))
    assert (again / "creep_1500V.nc").is_file()
    table = tmp_path / "comparison.csv"
    main(("compare", *map(str, sorted(RESULTS.glob("*/posterior.nc"))),
          "--prepared", str(RESULTS / "prepared"), "-o", str(table)))  # fmt: skip
    assert "lag_1" in table.read_text()
