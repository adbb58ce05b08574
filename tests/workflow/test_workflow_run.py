"""One whole small run: from records to report, and what an edit would run again."""

from __future__ import annotations

import csv
import os
import re
import shutil
from pathlib import Path

import pytest
from tests.workflow.snakemake_runs import ROOT, TINY, snakemake

from deabayes.cli.main import main
from deabayes.pipeline import compare_candidates
from deabayes.posteriors.storage import read_tree, write_tree


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run of one candidate under a budget far too small to converge."""
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "mine.yaml").write_text(TINY.format(root=ROOT))
    run = snakemake(folder, "--cores", "2", "--configfile", folder / "mine.yaml")
    logs = "\n".join(path.read_text() for path in folder.rglob("*.log") if path.stat().st_size)
    assert run.returncode == 0, run.stderr + logs
    return folder


def test_the_line_from_records_to_report(tiny: Path) -> None:
    results = tiny / "results"
    candidate = results / "tiny" / "voigt_kelvin_1"
    for path in (
        results / "tiny" / "study.yaml",
        results / "tiny" / "prepared" / "creep_2000V.nc",
        candidate / "posterior.nc",
        candidate / "predictions" / "creep_2500V.nc",
        results / "tiny" / "comparison.csv",
        results / "tiny" / "further_experiments.csv",
        results / "tiny" / "analyses" / "index.json",
        results / "report" / "index.html",
    ):
        assert path.is_file(), path
    assert list((results / "tiny" / "figures").glob("*.svg"))
    with (candidate / "errors.csv").open(newline="") as stream:
        rows = {row["experiment"]: row for row in csv.DictReader(stream)}
    assert rows["creep_2000V"]["role"] == "calibrate"
    assert rows["creep_2500V"]["role"] == "validate"


def test_further_experiments_bar_what_did_not_converge(tiny: Path) -> None:
    text = (tiny / "results" / "tiny" / "further_experiments.csv").read_text()
    assert text.startswith("experiment,what,") and len(text.splitlines()) == 1


def test_further_experiments_of_twins(tiny: Path, tmp_path: Path) -> None:
    """The same posterior under two names, taken as converged: nothing tells them apart."""
    source = tiny / "results" / "tiny"
    shutil.copytree(source / "prepared", tmp_path / "prepared")
    tree = read_tree(source / "voigt_kelvin_1" / "posterior.nc")
    verdict = "chosen: the smallest order the data cannot do without"
    lines = ["candidate,n_parameters,log_evidence,converged,verdict"]
    for name in ("one", "twin"):
        write_tree(tree, tmp_path / name / "posterior.nc")
        lines.append(f"{name},3,0,True,{verdict if name == 'one' else 'not chosen: elpd 0'}")
    (tmp_path / "comparison.csv").write_text("\n".join(lines))
    asked = "{longer: {like: creep_2000V, duration: 2}, too_much: {like: creep_2000V, speed: 2}}"
    main(["further", str(tmp_path), "--config", str(tmp_path / "none.yaml"), "--asked", asked])
    with (tmp_path / "further_experiments.csv").open(newline="") as stream:
        rows = {row["experiment"]: row for row in csv.DictReader(stream)}
    assert set(rows) == {"creep_2500V", "creep_1500V", "longer", "too_much"}
    for row in rows.values():
        assert row["candidates"] == "one, twin"
        error = float(row["information_candidate_error_nats"])
        assert float(row["information_candidate_nats"]) <= 3 * error + 1e-9
        assert float(row["information_twin_nats"]) > 0.0


def test_evidence_by_nested_sampling_stands_beside_that_by_bridge(
    tiny: Path, tmp_path: Path
) -> None:
    source, output = tiny / "results" / "tiny", tmp_path / "comparison.csv"
    shutil.copytree(source / "voigt_kelvin_1", tmp_path / "voigt_kelvin_1")
    posterior = tmp_path / "voigt_kelvin_1" / "posterior.nc"
    check = posterior.with_name("nested.json")
    check.write_text('{"log_evidence_nested": 10.0, "log_evidence_nested_error": 0.2}')

    def compared() -> dict[str, str]:
        compare_candidates([posterior], source / "prepared", output)
        with output.open(newline="") as stream:
            return next(csv.DictReader(stream))

    row = compared()
    assert (row["log_evidence_nested"], row["log_evidence_nested_error"]) == ("10.0", "0.2")
    assert "bridge and nested sampling differ by +20" in row["verdict"]
    os.utime(check, (1, 1))  # of a posterior from before this one
    row = compared()
    assert row["log_evidence_nested"] == "" and "nested" not in row["verdict"]


def test_what_did_not_converge_says_so(tiny: Path) -> None:
    candidate = tiny / "results" / "tiny" / "voigt_kelvin_1"
    with (candidate / "summary.csv").open(newline="") as stream:
        assert {row["converged"].lower() for row in csv.DictReader(stream)} == {"false"}
    page = (tiny / "results" / "report" / "index.html").read_text()
    assert "not converge" in page.lower()


def test_rerun_without_change_does_nothing(tiny: Path) -> None:
    run = snakemake(tiny, "--cores", "2", "--configfile", tiny / "mine.yaml")
    assert run.returncode == 0, run.stderr
    assert "Nothing to be done" in run.stderr + run.stdout


def planned(folder: Path, old: str, new: str) -> set[str]:
    """The rules that run again after an edit of the configuration."""
    edited = folder / "edited.yaml"
    text = TINY.format(root=ROOT)
    assert old in text
    edited.write_text(text.replace(old, new))
    run = snakemake(folder, "--cores", "1", "--dry-run", "--configfile", edited)
    assert run.returncode == 0, run.stderr
    return set(re.findall(r"^(?:local)?rule (\w+):", run.stdout, flags=re.MULTILINE))


def test_considering_another_experiment_fits_nothing_again(tiny: Path) -> None:
    rules = planned(tiny, "duration: 2", "duration: 3")
    assert rules == {"further_experiments", "figures", "report", "all"}


def test_checking_the_evidence_fits_nothing_again(tiny: Path) -> None:
    rules = planned(tiny, "    preparation:", "    evidence_check: nested\n    preparation:")
    assert rules == {"nested", "compare", "further_experiments", "figures", "report", "all"}


def test_editing_another_study_reruns_only_that_one(tiny: Path) -> None:
    edited = tiny / "edited.yaml"
    other = TINY.format(root=ROOT).split("studies:\n")[1].split("sampling:")[0]
    text = TINY.format(root=ROOT).replace("sampling:", other.replace("tiny:", "new:") + "sampling:")
    edited.write_text(text)
    run = snakemake(tiny, "--cores", "1", "--dry-run", "--configfile", edited)
    assert run.returncode == 0, run.stderr
    assert "results/new/voigt_kelvin_1/posterior.nc" in run.stdout
    assert "results/tiny/voigt_kelvin_1/posterior.nc" not in [
        line.split("output: ")[1].split(",")[0]
        for line in run.stdout.splitlines()
        if "output: " in line
    ]
