"""What `deabayes status` says of runs, from their files and logs."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder

from deabayes.cli.main import main

CONFIG = """\
pathvars: {results: out}
studies:
  vhb: {specimen: strip, candidates: [kv_gm_1, kv_gm_2, kv_gm_3]}
  wrong: {specimen: strip, candidates: [kv_gn_1]}
"""
LOG = """\
rule check:
    log: out/vhb/logs/check.log
    jobid: 1
[Sun Nov 29 15:22:36 2026]
Finished jobid: 1 (Rule: check)
1 of 9 steps (11%) done
rule fit:
    output: out/vhb/kv_gm_2/posterior.nc
    log: out/vhb/kv_gm_2/logs/fit.log
    jobid: 2
localrule fit:
    log: out/vhb/kv_gm_3/logs/fit.log
    jobid: 3
Error in rule fit:
    message: None
    jobid: 3
"""
PROGRESS = "warm-up: 100 %\nsampling, 300 steps, smallest ESS 81, R-hat 1.020, about 40 s left\n"


def write(path: str, text: str = "") -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One candidate done, one being fitted, one failed; a study with a fault."""
    make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    write("config.yaml", CONFIG)
    write("out/vhb/prepared/relax.nc")
    write("out/vhb/preview/index.json")
    write("out/vhb/kv_gm_1/posterior.nc")
    write("out/vhb/kv_gm_1/summary.csv", "parameter,converged\nmu_alpha,False\n")
    write("out/vhb/kv_gm_1/scores.json")
    write("out/vhb/kv_gm_2/logs/fit.log", PROGRESS)
    write("out/vhb/kv_gm_3/logs/fit.log", "no memory left\n")
    write(".snakemake/log/2026-11-29T152227.1.snakemake.log", LOG)
    return tmp_path


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    main(["status", *arguments])
    return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]


def test_a_run_that_goes_on(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(".snakemake/locks/0.output.lock")
    lines = said(capsys)
    assert lines[0].startswith("A run is going on: 1 of 9 jobs done, 1 running.")
    assert (
        "vhb: 1 of 2 records prepared; preview done; "
        "compare, further_experiments, analyse, figures left"
    ) in lines
    assert "kv_gm_1 fit done (NOT converged); score done; predict left" in lines
    assert (
        "kv_gm_2 fit running (sampling, 300 steps, smallest ESS 81, R-hat 1.020, about 40 s left)"
    ) in lines
    assert "kv_gm_3 fit FAILED (no memory left)" in lines
    assert "Report: not made yet" in lines
    assert any("kv_gn_1" in line for line in lines)


def test_a_run_that_ended(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write("out/report/index.html")
    lines = said(capsys, "--configfile", "config.yaml")
    assert lines[0] == "No run is going on."
    assert any(line.startswith("kv_gm_2 fit begun, not running (sampling") for line in lines)
    assert "Report: out/report/index.html" in lines


def test_nothing_was_run(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "--results", "nowhere")
    assert "vhb: 0 of 2 records prepared; preview, compare, further_experiments, analyse, " in (
        "\n".join(lines)
    )
    assert "kv_gm_1 fit left" in lines
