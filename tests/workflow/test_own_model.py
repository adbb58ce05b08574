"""The page on models of one's own, followed to the report, and what an edit of its model does."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import pytest
from tests.shared.own_model_page import write_page
from tests.workflow.snakemake_runs import snakemake

import deabayes
from deabayes.cli.main import main

CUT_SHORT = "sampling: {ensembles: 2, walkers: 24, max_steps: 100, particles: 64, seed: 1}\n"
MODEL = Path("models/stack.py")
POSTERIOR = Path("results/stack/lag_1/posterior.nc")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run of the page's study under a budget far too small to converge."""
    folder = write_page(tmp_path_factory.mktemp("own_model"))
    with (folder / "config.yaml").open("a", encoding="utf-8") as stream:
        stream.write(CUT_SHORT)
    finished = snakemake(folder, "--cores", "2")
    logs = "\n".join(path.read_text() for path in folder.rglob("*.log") if path.stat().st_size)
    assert finished.returncode == 0, finished.stderr + logs
    return folder


@pytest.fixture
def place(run: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run's folder as the working directory."""
    monkeypatch.chdir(run)
    return run


def planned(folder: Path) -> str:
    """What a run would do now, as a dry run lists it."""
    dry = snakemake(folder, "--cores", "1", "--dry-run")
    assert dry.returncode == 0, dry.stderr
    return dry.stdout + dry.stderr


def test_from_records_to_report(place: Path) -> None:
    results = Path("results/stack")
    page = Path("results/report/index.html").read_text()
    for text in ("stack A", "lag_0", "lag_1", "not converge"):
        assert text in page
    with (results / "comparison.csv").open(newline="") as stream:
        assert {(row["candidate"], row["order"]) for row in csv.DictReader(stream)} == {
            ("lag_0", "0"),
            ("lag_1", "1"),
        }
    with (results / "lag_1" / "errors.csv").open(newline="") as stream:
        roles = {row["experiment"]: row["role"] for row in csv.DictReader(stream)}
    assert roles == {"creep_1000V": "calibrate", "creep_1500V": "validate"}
    assert (results / "analyses" / "index.json").is_file()
    assert list((results / "figures").glob("*.svg"))


def test_its_posterior_knows_its_model(place: Path, tmp_path: Path) -> None:
    post = deabayes.open_posterior(POSTERIOR)
    assert post.data.attrs["model_file"] == str(MODEL)
    assert {"Y", "tau", "thickness"} <= set(post.names)
    band = post.predict(time=[0.0, 0.5], voltage=[1000.0, 1000.0])
    assert float(band["median"][-1]) == pytest.approx(8.9e-5, rel=0.2)
    main(("export", str(POSTERIOR), "--to", "csv", "-o", str(tmp_path / "draws.csv")))
    assert "Y" in (tmp_path / "draws.csv").read_text().splitlines()[0]
    again = tmp_path / "again"
    main(("predict", str(POSTERIOR), "-o", str(again), "--errors", str(again / "errors.csv")))
    assert (again / "creep_1500V.nc").is_file()
    table = tmp_path / "comparison.csv"
    main(("compare", *map(str, sorted(place.glob("results/stack/*/posterior.nc"))),
          "--prepared", "results/stack/prepared", "-o", str(table)))  # fmt: skip
    assert "lag_1" in table.read_text()


def test_without_a_change_nothing_is_run(place: Path) -> None:
    assert "Nothing to be done" in planned(place)


def test_an_edit_of_the_model_fits_again(place: Path, tmp_path: Path) -> None:
    kept = shutil.copy2(MODEL, tmp_path)
    MODEL.write_text(MODEL.read_text() + "# edited\n")
    try:
        plan = planned(place)
    finally:
        shutil.copy2(kept, MODEL)
    jobs = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", plan, re.MULTILINE)}
    assert (jobs["fit"], jobs["predict"], jobs["report"]) == (2, 2, 1)
    assert "prepare" not in jobs
    assert "Nothing to be done" in planned(place)
