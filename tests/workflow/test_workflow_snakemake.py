"""The workflow from outside: what it plans, what it says, and one whole small run."""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake.exceptions import WorkflowError

from deabayes.commands.by_hand import weigh_experiments
from deabayes.pipeline import compare_candidates
from deabayes.posteriors.storage import read_tree, write_tree

ROOT = Path(__file__).resolve().parents[2]
PUBLIC = ("vhb4910", "treloar", "silicones")
TINY = """
studies:
  tiny:
    specimen: {root}/data/tubular
    candidates: [voigt_kelvin_1]
    calibrate: [creep_2000V]
    validate: [creep_2500V, creep_1500V]
    further_experiments: {{longer: {{like: creep_2000V, duration: 2}}}}
    preparation:
      creep:
        - delay: {{}}
        - baseline: {{}}
        - mask_before: {{time: 6 ms, from_step: true}}
        - excitation_knots: {{tolerance: 2 V}}
        - average: {{grid: geometric, first_width: 4 ms, ratio: 1.2, widest: 20 ms}}
sampling: {{ensembles: 2, walkers: 24, max_steps: 200, particles: 64, seed: 1}}
"""


def snakemake(
    folder: Path, *arguments: str | Path, data: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run in `folder`, without a terminal, with public data only where `data` says."""
    binaries = Path(sys.executable).parent
    empty_cache = folder / "no_cache"
    return subprocess.run(
        [binaries / "snakemake", "--snakefile", ROOT / "Snakefile", "--directory", folder]
        + [str(each) for each in arguments],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=540,
        env={
            **os.environ,
            "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}",
            "DEABAYES_DATA": "" if data is None else str(data),
            "XDG_CACHE_HOME": str(empty_cache),
        },
        check=False,
    )


class Remote:
    """A workflow under a remote executor that was told no number of cores."""

    @property
    def cores(self) -> int:
        raise WorkflowError("Workflow requires a total number of cores to be defined")


def test_pooling_needs_no_number_of_cores() -> None:
    text = (ROOT / "workflow" / "rules" / "inputs.smk").read_text()
    (function,) = re.findall(r"^def pooling_threads.*?(?=^def )", text, re.DOTALL | re.MULTILINE)
    of_four = SimpleNamespace(ensembles=["1.nc", "2.nc", "3.nc", "4.nc"])
    for workflow, expected in (
        (Remote(), 4),
        (SimpleNamespace(cores=None), 4),
        (SimpleNamespace(cores=2), 1),
        (SimpleNamespace(cores=6), 3),
    ):
        names = {"workflow": workflow, "WorkflowError": WorkflowError}
        exec(function, names)
        assert names["pooling_threads"](None, of_four) == expected


@pytest.fixture
def shipped(tmp_path: Path) -> Path:
    """A folder with the shipped configuration and study folders, and no results."""
    for name in ("config.yaml", "data"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def test_shipped_studies_without_public_data(shipped: Path) -> None:
    run = snakemake(shipped, "--cores", "1", "--dry-run")
    assert run.returncode == 0, run.stderr
    for study in PUBLIC:
        lines = [line for line in run.stderr.splitlines() if line.startswith(study)]
        assert lines, f"nothing said about {study}"
        assert all("left out" in line and "make data" in line for line in lines)
        assert all("DEABAYES_DATA" in line for line in lines)
        assert f"results/{study}" not in run.stdout
    assert "results/tubular/voigt_kelvin_3/ensembles/4.nc" in run.stdout
    assert not (shipped / "results").exists()


@pytest.mark.parametrize(("cores", "processes"), [(1, 1), (2, 1), (4, 2), (8, 4), (16, 4)])
def test_pooling_takes_half_of_the_cores(shipped: Path, cores: int, processes: int) -> None:
    target = "results/tubular_circuit/circuit/posterior.nc"
    run = snakemake(shipped, "--cores", str(cores), "--dry-run", "--printshellcmds", target)
    assert re.findall(r"--processes (\d+)", run.stdout) == [str(processes)], run.stderr


def test_public_data_at_hand_are_planned(shipped: Path) -> None:
    data = Path(os.environ.get("DEABAYES_DATA") or ROOT.parent / "shared" / "data")
    if not data.is_dir():
        pytest.skip(f"no public data: {data} does not exist and DEABAYES_DATA is not set")
    run = snakemake(shipped, "--cores", "1", "--dry-run", data=data)
    assert run.returncode == 0, run.stderr
    assert "left out" not in run.stderr
    assert "results/vhb4910/kv_gm_4/posterior.nc" in run.stdout
    assert (
        run.stdout.count("rule prepare:") == 19
    )  # tubular four times, membrane and structure twice, vhb4910, treloar, eight silicones


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ("studies: {a: {specimen: data/tubular, candidtaes: [x]}}", ("candidtaes", "candidates")),
        ("studies: {a: {specimen: data/tubular, candidates: []}}", ("candidates",)),
        ("studies: {a: {candidates: [voigt_kelvin_1]}}", ("specimen",)),
        ("studies: {a: {specimen: nowhere, candidates: [voigt_kelvin_1]}}", ("nowhere",)),
        (
            f"studies: {{a: {{specimen: {ROOT}/data/tubular, candidates: [voigt_kelvon_1],"
            " calibrate: [creep_2O00V]}}",
            ("voigt_kelvon_1", "voigt_kelvin_K", "creep_2O00V", "did you mean 'creep_"),
        ),
    ],
)
def test_a_broken_configuration_is_a_message(
    tmp_path: Path, config: str, words: tuple[str, ...]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(config)
    run = snakemake(tmp_path, "--cores", "1", "--configfile", path)
    assert run.returncode != 0
    assert "Traceback" not in run.stderr
    assert "common.smk" not in run.stderr, "where in our files it was found is no help"
    for word in words:
        assert word in run.stderr


def test_what_a_job_complains_of_is_shown(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "data" / "tubular", tmp_path / "tubular")
    record = tmp_path / "tubular" / "records" / "creep_2000V.csv"
    lines = record.read_text().splitlines()
    record.write_text("\n".join([*lines[:50], "broken,row", *lines[50:]]))
    path = tmp_path / "mine.yaml"
    path.write_text(TINY.replace("{root}/data/", "").format())
    run = snakemake(tmp_path, "--cores", "1", "--quiet", "rules", "--configfile", path)
    assert run.returncode != 0
    assert "Traceback" not in run.stderr
    assert "creep_2000V.csv" in run.stderr.split("RuleException")[0]


def test_own_configuration_replaces_the_shipped_one(shipped: Path) -> None:
    path = shipped / "mine.yaml"
    path.write_text(TINY.format(root=ROOT))
    run = snakemake(shipped, "--cores", "1", "--dry-run", "--configfile", path)
    assert run.returncode == 0, run.stderr
    assert "results/tiny/voigt_kelvin_1/posterior.nc" in run.stdout
    assert "results/tubular" not in run.stdout


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
    weigh_experiments(tmp_path, tmp_path / "none.yaml", asked, None)
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
    assert "bridge and nested sampling differ by +206" in row["verdict"]
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
