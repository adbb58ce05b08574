"""The profiles' own studies: each is one that can be run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.workflow.snakemake_runs import ROOT

from deabayes.checks.study import check_study
from deabayes.records.schema import read_yaml
from deabayes.studies import load_studies

PROFILES = ROOT / "workflow" / "profiles"
WITH_STUDIES = sorted(path.parent.name for path in PROFILES.glob("*/studies.yaml"))


@pytest.mark.parametrize("name", WITH_STUDIES)
def test_their_studies_have_no_faults(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    path = PROFILES / name / "studies.yaml"
    studies = load_studies(read_yaml(path), str(path))
    assert studies
    for study in studies:
        assert check_study(study).faults == []


def test_four_terms_come_beside_the_shipped_studies(tmp_path: Path) -> None:
    """Stage 1 is fitted first, as the shipped configuration says."""
    target = "results/minimum_energy_structure_four_terms/figures"
    profile = ["--workflow-profile", str(PROFILES / "four_terms")]
    command = [Path(sys.executable).parent / "snakemake", "--dry-run", "--forceall", "--nolock"]
    run = subprocess.run(
        [*command, *profile, target],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stderr
    fits = set(re.findall(r"^ *fit +(\d+)$", run.stdout, re.MULTILINE))
    assert fits == {"5"}  # ogden_4 at rest and four candidates in motion
