"""The workflow from outside: what it plans, and what it says."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.workflow.snakemake_runs import ROOT, TINY, snakemake

PUBLIC = ("vhb4910", "treloar", "silicones")


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
    assert "results/tubular/voigt_kelvin_3/posterior.nc" in run.stdout
    assert not (shipped / "results").exists()


def test_public_data_at_hand_are_planned(shipped: Path) -> None:
    data = Path(os.environ.get("DEABAYES_DATA") or ROOT.parent / "shared" / "data")
    if not data.is_dir():
        pytest.skip(f"no public data: {data} does not exist and DEABAYES_DATA is not set")
    run = snakemake(shipped, "--cores", "1", "--dry-run", data=data)
    assert run.returncode == 0, run.stderr
    assert "left out" not in run.stderr
    assert "results/vhb4910/kv_gm_4/posterior.nc" in run.stdout
    # tubular three times, membrane, structure twice, vhb4910, treloar, eight silicones
    assert run.stdout.count("rule check:") == 16
    assert run.stdout.count("rule prepare:") == 86


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (
            "studies: {a: {specimen: data/tubular, candidtaes: [x]},"
            " b: {specimen: data/tubular, candidates: []}, c: {candidates: [voigt_kelvin_1]}}",
            ("candidtaes", "candidates", "studies.b.candidates", "studies.c", "'specimen'"),
        ),
        (
            f"studies: {{a: {{specimen: {ROOT}/data/tubular, candidates: [voigt_kelvon_1],"
            " calibrate: [creep_2O00V]}}",
            ("voigt_kelvon_1", "voigt_kelvin_K", "creep_2O00V", "did you mean 'creep_"),
        ),
        ("studies: {a: {specimen: nowhere, candidates: [voigt_kelvin_1]}}", ("nowhere",)),
    ],
    ids=["keys", "names", "folder"],
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


def test_own_configuration_replaces_the_shipped_one(shipped: Path) -> None:
    path = shipped / "mine.yaml"
    path.write_text(TINY.format(root=ROOT))
    run = snakemake(shipped, "--cores", "1", "--dry-run", "--configfile", path)
    assert run.returncode == 0, run.stderr
    assert "results/tiny/voigt_kelvin_1/posterior.nc" in run.stdout
    assert "results/tubular" not in run.stdout
