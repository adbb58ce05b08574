"""Plain `snakemake`: what a run says, a study with faults beside others, wrong targets and files.

A stub stands for `deabayes`: nothing is computed.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from tests.workflow.snakemake_runs import ROOT, TINY, snakemake, write_stub

from snakemake_logger_plugin_deabayes import WIDEST, ShortLines, fault_of_config_files

BAD = """\
  bad: {specimen: {root}/data/tubular, candidates: [voigt_kelvon_1], calibrate: [creep_2000V]}
  worse: {specimen: {root}/data/tubular, candidtaes: [voigt_kelvin_1]}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound study beside two with faults."""
    place = tmp_path_factory.mktemp("running")
    bad = BAD.replace("{root}", str(ROOT))
    text = TINY.format(root=ROOT).replace("sampling:", f"{bad}sampling:")
    (place / "config.yaml").write_text(text)
    write_stub(place)
    return place


@pytest.fixture(scope="module")
def run(place: Path) -> CompletedProcess[str]:
    return snakemake(place, "--cores", "1")


def test_faults_of_a_study_are_said_once_and_end_the_run_after_the_rest(
    place: Path, run: CompletedProcess[str]
) -> None:
    assert run.returncode == 1 and "Traceback" not in run.stderr
    assert run.stderr.count("'candidtaes'; did you mean 'candidates'?") == 1
    assert run.stderr.count("'voigt_kelvon_1' is unknown") == 1
    before, _, after = run.stderr.partition("Building DAG of jobs")
    assert "worse, bad left out because of these faults" in before
    assert re.search(r"done +report", after)
    assert "Failed: faults bad results/bad/logs/faults.log" in after.splitlines()
    assert "kelvon" in (place / "results/bad/logs/faults.log").read_text()
    assert (place / "results/report/index.html").is_file()


def test_a_job_has_a_line_as_it_begins_and_one_as_it_ends(run: CompletedProcess[str]) -> None:
    assert run.stdout == ""
    after = run.stderr.partition("Building DAG of jobs")[2]
    assert max(map(len, after.splitlines())) < WIDEST
    log = "results/tiny/voigt_kelvin_1/logs/fit.log"
    assert re.search(rf"begins +fit tiny voigt_kelvin_1 +{log}", after)
    assert re.search(r"done +fit tiny voigt_kelvin_1 +\d+ of \d+ jobs", after)


def test_the_preview_is_the_first_result(run: CompletedProcess[str]) -> None:
    done = re.findall(r"done +(\w+) tiny", run.stderr)
    assert set(done[: done.index("preview")]) == {"check", "prepare"}


def test_faults_remain_an_error_when_all_else_is_done(
    place: Path, run: CompletedProcess[str]
) -> None:
    again = snakemake(place, "--cores", "1")
    assert again.returncode == 1
    assert "begins" not in again.stderr and "Failed: faults bad" in again.stderr
    plan = snakemake(place, "--cores", "1", "--dry-run")
    assert plan.returncode == 1
    assert "rule faults" in plan.stdout and "This was a dry-run" in plan.stdout


def test_a_target_of_one_study_leaves_the_others(place: Path) -> None:
    plan = snakemake(place, "--cores", "1", "--dry-run", "--forceall", "results/tiny/figures")
    assert plan.returncode == 0 and plan.stderr == ""
    assert "results/bad" not in plan.stdout and "rule preview" not in plan.stdout
    assert max(map(len, plan.stdout.splitlines())) <= WIDEST


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        (
            ("results/tiny/comparisons.csv", "tiny", "fit", "rubbish"),
            (
                "results/tiny/comparisons.csv: nothing makes such a file; did you mean "
                "'results/tiny/comparison.csv'?",
                "tiny: is a study; name a result of it: results/tiny/figures",
                "fit: is a rule; name one of the files that it makes: results/{study}/{candidate}/",
                "rubbish: nothing makes such a file; name a result, such as results/tiny/figures",
            ),
        ),
        (("results/tinny/figures",), ("there is no study 'tinny'; did you mean 'tiny'?",)),
        (("results/bad/figures",), ("'voigt_kelvon_1' is unknown",)),
    ],
    ids=["no file", "no study", "faulty"],
)
def test_a_wrong_target_is_one_sentence(
    place: Path, targets: tuple[str, ...], words: tuple[str, ...]
) -> None:
    ended = snakemake(place, "--cores", "1", *targets)
    assert ended.returncode == 1 and ended.stdout == ""
    lines = ended.stderr.splitlines()
    for line, said in zip(lines, words, strict=True):
        assert said in line


def test_a_target_taken_for_a_config_file_is_one_sentence(place: Path) -> None:
    target = "results/tiny/figures"
    ended = snakemake(place, "--cores", "1", "--configfile", place / "config.yaml", target)
    assert ended.returncode == 1 and ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert f"{target}: is taken for a configuration file" in ended.stderr
    assert f"snakemake --cores 2 {target} --configfile {place / 'config.yaml'}" in ended.stderr


def test_config_files_that_cannot_be_read_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ours = ["--snakefile", str(ROOT / "Snakefile")]
    Path("mine.yaml").write_text("a: 1")
    Path("twice.yaml").write_text("a: 1\na: 2")
    assert fault_of_config_files([*ours, "--configfile", "mine.yaml", "-n"]) == ""
    assert fault_of_config_files([*ours, "target", "--cores", "2"]) == ""
    assert fault_of_config_files([*ours, "--configfile"]) == "", "Snakemake says it"
    missing = fault_of_config_files([*ours, "--configfile=mine.yml"])
    assert missing.startswith("mine.yml: there is no such file")
    second = fault_of_config_files([*ours, "--configfiles", "mine.yaml", "twice.yaml"])
    assert second.startswith("twice.yaml, line 2: key 'a' is given twice")


def test_other_peoples_workflows_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Snakefile").write_text("rule all:\n")
    assert fault_of_config_files(["--configfile", "missing.yaml"]) == ""
    Path("Snakefile").unlink()
    assert fault_of_config_files(["--configfile", "missing.yaml"]) == ""


def test_long_lines_of_a_plan_are_cut() -> None:
    record = logging.LogRecord("x", logging.INFO, "", 0, f"rule fit:\n{'a' * 300}", None, None)
    first, second = ShortLines(logging.Formatter()).format(record).split("\n")
    assert first == "rule fit:"
    assert len(second) == WIDEST and second.endswith(" ...")
