"""What an edit runs again, and what it leaves: nothing is sampled twice for nothing."""

from __future__ import annotations

import os
import re
import shutil
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from tests.shared.own_model_page import write_page
from tests.shared.study_folders import replace_in
from tests.workflow.snakemake_runs import snakemake

BUDGET = "sampling: {ensembles: 2, walkers: 24, max_steps: 60, particles: 64, seed: 1}\n"
ONE = "results/stack/lag_0/posterior.nc"
BOTH = (ONE, "results/stack/lag_1/posterior.nc")
RECORDS = Path("data/stack/records")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's study of one candidate, fitted with too small a budget."""
    place = write_page(tmp_path_factory.mktemp("stack"))
    with (place / "config.yaml").open("a") as config:
        config.write(BUDGET)
    replace_in(place / "config.yaml", "[lag_0, lag_1]", "[lag_0]")
    shutil.copy(place / RECORDS / "creep_1500V.csv", place / RECORDS / "creep_more.csv")
    run = snakemake(place, "--cores", "1", ONE)
    assert run.returncode == 0, run.stderr
    return place


@pytest.fixture
def place(fitted: Path) -> Iterator[Path]:
    """The same, put back as it was after a test has edited it."""
    paths = [path for part in ("data", "models") for path in sorted((fitted / part).rglob("*"))]
    kept = [path for path in [*paths, fitted / "config.yaml"] if path.is_file()]
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in kept}
    yield fitted
    for path, (content, changed) in before.items():
        path.write_bytes(content)
        os.utime(path, ns=(changed, changed))


def planned(place: Path, *targets: str) -> dict[str, int]:
    """How many jobs of each rule would run."""
    run = snakemake(place, "--cores", "1", "--dry-run", *targets)
    assert run.returncode == 0, run.stderr
    rules = re.findall(r"^(?:local)?rule (\w+):", run.stdout, flags=re.MULTILINE)
    return {rule: rules.count(rule) for rule in rules}


def test_without_an_edit_nothing_runs(place: Path) -> None:
    assert planned(place, ONE) == {}


def test_a_new_candidate_is_fitted_alone(place: Path) -> None:
    replace_in(place / "config.yaml", "[lag_0]", "[lag_0, lag_1]")
    jobs = planned(place, *BOTH)
    assert jobs["fit"] == 1
    assert "prepare" in jobs and "code" not in jobs


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("config.yaml", "    candidates", "    validate: []\n    candidates"),
        ("data/stack/records/creep_1500V.csv", "\n", "\n\n"),
        (
            "data/stack/experiments.csv",
            "creep_1500V,creep,",
            "more,creep,records/creep_more.csv,validate,voltage,displacement\ncreep_1500V,creep,",
        ),
    ],
    ids=["none held out", "blank line", "one more"],
)
def test_held_out_records_fit_nothing_again(place: Path, file: str, old: str, new: str) -> None:
    text = (place / file).read_text()
    assert old in text
    (place / file).write_text(text.replace(old, new, 1))
    jobs = planned(place, ONE, "results/stack/prepared")
    assert "prepare" in jobs and "fit" not in jobs


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("config.yaml", "seed: 1", "seed: 2"),
        ("config.yaml", "    candidates", "    calibrate: [creep_1500V]\n    candidates"),
        ("data/stack/specimen.yaml", "value: ", "value: 1"),
        ("data/stack/records/creep_1000V.csv", "0", "1"),
        ("models/stack.py", '"wide"', '"vast"'),
    ],
    ids=["seed", "calibrated", "specimen", "record", "model"],
)
def test_what_a_fit_is_made_of_is_fitted_again(place: Path, file: str, old: str, new: str) -> None:
    """Also where another candidate is asked for at once, which makes study.yaml again."""
    text = (place / file).read_text()
    assert old in text
    (place / file).write_text(text.replace(old, new, 1))
    try:
        assert planned(place, ONE)["fit"] == 1
        replace_in(place / "config.yaml", "[lag_0]", "[lag_0, lag_1]")
        assert planned(place, *BOTH)["fit"] == 2
    finally:
        (place / file).write_text(text)


def test_what_an_edit_and_an_interruption_left_is_made(place: Path) -> None:
    """The run that made study.yaml again was ended before it came to `compile` and to the fit."""
    before = (place / "config.yaml").read_text()
    replace_in(place / "config.yaml", "    candidates", "    validate: []\n    candidates")
    summary = place / "results/stack/lag_0/summary.csv"
    kept = summary.read_bytes()
    assert snakemake(place, "--cores", "1", "results/stack/prepared").returncode == 0
    summary.unlink()
    try:
        assert planned(place, str(summary.relative_to(place))) == {"fit": 1}
    finally:
        summary.write_bytes(kept)
        (place / "config.yaml").write_text(before)
        snakemake(place, "--cores", "1", "results/stack/prepared")


def test_a_job_has_one_thread(fitted: Path, tmp_path: Path) -> None:
    place = tmp_path / "stack"
    shutil.copytree(fitted, place)
    with (place / "models" / "stack.py").open("a") as model:
        model.write("\nimport os\nprint('threads:', os.environ['OMP_NUM_THREADS'])\n")
    run = snakemake(place, "--cores", "4", ONE)
    assert run.returncode == 0, run.stderr
    assert "threads: 1\n" in (place / "results/stack/lag_0/logs/fit.log").read_text()


def test_a_run_that_could_not_see_what_is_missing_says_so(fitted: Path) -> None:
    """What one study holds out is edited; asked for is a study that has its prior from there."""
    place, other = fitted.with_name("other0"), "results/other/lag_0/posterior.nc"
    shutil.copytree(fitted, place)
    config = yaml.safe_load((place / "config.yaml").read_text())
    study = config["studies"]["stack"]
    edited, after = study | {"validate": []}, {"calibrate": ["creep_1500V"], "validate": []}
    studies = {"stack": edited, "other": study | after | {"prior_from": ONE}}
    (place / "config.yaml").write_text(yaml.safe_dump(config | {"studies": studies}))
    run = snakemake(place, "--cores", "1", other)
    assert run.returncode != 0 and f"{other}: not made" in run.stderr + run.stdout
    run = snakemake(place, "--cores", "1", other)
    assert run.returncode == 0 and (place / other).exists(), run.stderr


def test_a_fit_that_an_interruption_left_is_made(fitted: Path) -> None:
    """The run after an edit of the model was ended before `compile`, which comes before the fit."""
    place = fitted.with_name("left0")
    shutil.copytree(fitted, place)
    replace_in(place / "models" / "stack.py", '"wide"', '"vast"')
    assert snakemake(place, "--cores", "1", "results/stack/logs/code").returncode == 0
    assert planned(place, ONE) == {"compile": 1, "fit": 1}
    replace_in(place / "config.yaml", "    candidates", "    validate: []\n    candidates")
    assert planned(place, ONE).keys() >= {"prepare", "compile", "fit"}


def test_a_record_replaced_by_an_older_file_is_seen(place: Path) -> None:
    record = place / RECORDS / "creep_1000V.csv"
    changed = record.stat().st_mtime - 1e6
    replace_in(record, record.read_text().splitlines()[-1], "0.9,1000,0.0001")
    os.utime(record, (changed, changed))
    jobs = planned(place, ONE)
    assert {"prepare", "fit"} <= set(jobs)


def test_what_a_power_cut_left_is_made_again_as_the_page_says(place: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "resume.md").read_text()
    assert "`snakemake --unlock`" in page and "--rerun-incomplete" in page
    held = place / ONE
    (place / ".snakemake" / "incomplete").mkdir(exist_ok=True)
    marker = b64encode(str(held.relative_to(place)).encode()).decode()
    (place / ".snakemake" / "incomplete" / marker).touch()
    run = snakemake(place, "--cores", "1", "--dry-run", ONE)
    assert run.returncode != 0 and "--rerun-incomplete" in run.stderr + run.stdout
    run = snakemake(place, "--cores", "1", "--dry-run", "--rerun-incomplete", ONE)
    (place / ".snakemake" / "incomplete" / marker).unlink()
    assert run.returncode == 0 and ONE in run.stdout
