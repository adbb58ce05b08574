"""What an edit runs again, and what it leaves: nothing is sampled twice for nothing.

Every edit is made in a study of its own, so that one plan shows them all. A stub stands for
`deabayes`: Snakemake plans by files, parameters and its own records, not by what is in results.
"""

from __future__ import annotations

import os
import shutil
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.shared.own_model_page import write_page
from tests.shared.study_folders import replace_in
from tests.workflow.snakemake_runs import planned, snakemake, write_stub

Edit = Callable[[Path, dict[str, Any]], None]
"""Of a study's folder and of its entry in config.yaml."""


def in_config(**settings: object) -> Edit:
    return lambda _, study: study.update(settings)


def in_file(name: str, old: str, new: str) -> Edit:
    return lambda folder, _: replace_in(folder / name, old, new)


def older_record(folder: Path, _: dict[str, Any]) -> None:
    """Put an older file, with another last reading, in the place of the calibrated record."""
    record = folder / "records" / "creep_1000V.csv"
    changed = record.stat().st_mtime - 1e6
    replace_in(record, record.read_text().splitlines()[-1], "0.9,1000,0.0001")
    os.utime(record, (changed, changed))


def lost_summary(folder: Path, study: dict[str, Any]) -> None:
    """An edit that fits nothing again, after a run that ended before a fit was complete."""
    study["validate"] = []
    (folder.parents[1] / "results" / folder.name / "lag_0" / "summary.csv").unlink()


def touched(folder: Path, _: dict[str, Any]) -> None:
    os.utime(folder / "records" / "creep_1000V.csv")


BOTH = {"prepare creep_1000V", "prepare creep_1500V"}
AFTER = {"predict lag_0"}
FIT = {"fit lag_0"} | AFTER
ROW = "creep_1500V,creep,records/creep_1500V.csv,"
MORE = f"more,creep,records/more.csv,validate,voltage,displacement\n{ROW}"
SEED = {"ensembles": 2, "seed": 2}
EDITS: dict[str, tuple[Edit, set[str]]] = {
    "no_edit": (in_config(), set()),
    "another_time": (touched, set()),
    "comment": (in_file("specimen.yaml", "# an sd", "# its sd"), {"check"}),
    "new_candidate": (
        in_config(candidates=["lag_0", "lag_1"]),
        {"check", "fit lag_1", "predict lag_1"},
    ),
    "none_held_out": (in_config(validate=[]), {"check"} | AFTER),
    "blank_line_held_out": (
        in_file("records/creep_1500V.csv", "\n0,", "\n\n0,"),
        {"check", "prepare creep_1500V"} | AFTER,
    ),
    "one_more_held_out": (
        in_file("experiments.csv", ROW, MORE),
        {"check", "prepare more"} | AFTER,
    ),
    "summary_lost": (lost_summary, {"check"} | FIT),
    "seed": (in_config(sampling=SEED), {"check"} | FIT),
    "calibrated": (
        in_config(calibrate=["creep_1500V"], validate=["creep_1000V"]),
        {"check"} | BOTH | FIT,
    ),
    "one_more_calibrated": (
        in_config(calibrate=["creep_1000V", "creep_1500V"], validate=[]),
        {"check", "prepare creep_1500V"} | FIT,
    ),
    "specimen": (in_file("specimen.yaml", "value: 10", "value: 11"), {"check"} | BOTH | FIT),
    "record": (older_record, {"check", "prepare creep_1000V"} | FIT),
    "steps": (in_config(preparation={"creep": ["average"]}), {"check"} | BOTH | FIT),
    "further": (
        in_config(further_experiments={"longer": {"like": "creep_1000V", "duration": 3}}),
        {"further_experiments", "figures"},
    ),
    "evidence": (
        in_config(evidence_check="nested"),
        {"nested lag_0", "compare", "further_experiments", "figures"},
    ),
}
WHOLE = ("further", "evidence")
"""Studies that are run to their figures."""
INHERITED = {"after_seed": FIT, "after_blank_line_held_out": set()}
"""Studies whose prior is a posterior of a study that is edited, and what runs again of them."""
ONE = "results/no_edit/lag_0/posterior.nc"


def write_config(place: Path, studies: dict[str, Any]) -> None:
    config = yaml.safe_load((place / "config.yaml").read_text())
    (place / "config.yaml").write_text(yaml.safe_dump(config | {"studies": studies}))


def targets(studies: dict[str, Any]) -> list[str]:
    """What is asked for: predictions of every candidate, or figures."""
    made = [f"results/{name}/study.yaml" for name in studies]
    made.append("results/summary_lost/lag_0/summary.csv")
    made += [f"results/{name}/figures" for name in WHOLE]
    return made + [
        f"results/{name}/{candidate}/errors.csv"
        for name, study in studies.items()
        for candidate in study["candidates"]
    ]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one study per edit, each of one candidate of the page's model."""
    place = write_page(tmp_path_factory.mktemp("edits"))
    write_stub(place)
    studies = {}
    for name in EDITS:
        shutil.copytree(place / "data" / "stack", place / "data" / name)
        studies[name] = {"specimen": f"data/{name}", "candidates": ["lag_0"]}
        shutil.copy(
            place / "data/stack/records/creep_1500V.csv", place / f"data/{name}/records/more.csv"
        )
    for name in INHERITED:
        studies[name] = {
            "specimen": "data/stack",
            "candidates": ["lag_0"],
            "calibrate": ["creep_1500V"],
            "validate": [],
            "prior_from": f"results/{name.removeprefix('after_')}/lag_0/posterior.nc",
        }
    write_config(place, studies)
    run = snakemake(place, "--cores", "2", *targets(studies))
    assert run.returncode == 0, run.stderr
    return place


@pytest.fixture(scope="module")
def jobs(place: Path) -> dict[str, set[str]]:
    """The jobs planned for each study after its edit, without its name."""
    studies = yaml.safe_load((place / "config.yaml").read_text())["studies"]
    for name, (edit, _) in EDITS.items():
        edit(place / "data" / name, studies[name])
    write_config(place, studies)
    words = [job.split() for job in planned(place, *targets(studies)) if " " in job]
    return {
        name: {" ".join([rule, *more]) for rule, study, *more in words if study == name}
        for name in studies
    }


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_runs_again_what_depends_on_it(jobs: dict[str, set[str]], name: str) -> None:
    assert jobs[name] == EDITS[name][1]


@pytest.mark.parametrize("name", INHERITED)
def test_a_prior_from_an_edited_study_is_fitted_again(jobs: dict[str, set[str]], name: str) -> None:
    """Only if that study is fitted again."""
    assert jobs[name] == INHERITED[name]


def test_an_edit_of_an_own_model_fits_again_and_prepares_nothing(
    place: Path, jobs: dict[str, set[str]]
) -> None:
    replace_in(place / "models" / "stack.py", '"wide"', '"vast"')
    assert planned(place, ONE) == {"fit no_edit lag_0"}
    replace_in(place / "models" / "stack.py", '"vast"', '"wide"')


def test_a_job_has_one_thread(place: Path) -> None:
    assert "threads: 1\n" in (place / "results/no_edit/lag_0/logs/fit.log").read_text()


def test_records_that_a_study_no_longer_has_are_removed(
    place: Path, jobs: dict[str, set[str]]
) -> None:
    """Stages read all prepared records in the folder."""
    prepared = place / "results" / "none_held_out" / "prepared"
    assert (prepared / "creep_1500V.nc").is_file()
    run = snakemake(place, "--cores", "1", "results/none_held_out/lag_0/errors.csv")
    assert run.returncode == 0, run.stderr
    assert sorted(path.name for path in prepared.iterdir()) == [
        "creep_1000V.nc",
        "creep_1000V.yaml",
    ]


def test_what_a_power_cut_left_is_made_again_as_the_page_says(place: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "resume.md").read_text()
    assert "`snakemake --unlock`" in page and "--rerun-incomplete" in page
    (place / ".snakemake" / "incomplete").mkdir(exist_ok=True)
    marker = place / ".snakemake" / "incomplete" / b64encode(ONE.encode()).decode()
    marker.touch()
    run = snakemake(place, "--cores", "1", "--dry-run", ONE)
    assert run.returncode != 0 and "--rerun-incomplete" in run.stderr + run.stdout
    assert "fit no_edit lag_0" in planned(place, "--rerun-incomplete", ONE)
    marker.unlink()
