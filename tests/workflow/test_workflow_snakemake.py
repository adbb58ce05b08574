"""The workflow from outside: what it plans, what it says, and one whole small run."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PUBLIC = ("vhb4910", "treloar", "silicones")
TINY = """
studies:
  tiny:
    specimen: {root}/data/tubular
    candidates: [voigt_kelvin_1]
    calibrate: [creep_2000V]
    validate: [creep_2500V, creep_1500V]
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
        results / "tiny" / "analyses" / "index.json",
        results / "report" / "index.html",
    ):
        assert path.is_file(), path
    assert list((results / "tiny" / "figures").glob("*.svg"))
    with (candidate / "errors.csv").open(newline="") as stream:
        rows = {row["experiment"]: row for row in csv.DictReader(stream)}
    assert rows["creep_2000V"]["role"] == "calibrate"
    assert rows["creep_2500V"]["role"] == "validate"


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
