"""The notebooks and the tutorial do what they show, on small posteriors in place of long ones."""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import yaml
from tests.workflow.snakemake_runs import planned

import deabayes
from deabayes.cli.fitting import fit_by_name
from deabayes.cli.main import main

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
TUTORIAL = (ROOT / "docs/tutorial.md").read_text("utf-8")
SAMPLING = {"ensembles": 2, "walkers": 24, "max_steps": 40, "particles": 32, "seed": 1}
COARSE = {"grid": "geometric", "ratio": 1.5}
QUICK = {
    "specimen": "data/tubular",
    "candidates": ["voigt_kelvin_2"],
    "calibrate": ["creep_2000V"],
    "validate": ["creep_1500V"],
    "preparation": {
        "creep": [
            {"baseline": {}},
            {"mask_before": {"time": "6 ms", "from_step": True}},
            {"excitation_knots": {"tolerance": "2 V"}},
            {"average": {**COARSE, "first_width": "4 ms", "widest": "20 ms"}},
        ]
    },
}
FULL = {
    "specimen": "data/tubular",
    "candidates": ["voigt_kelvin_1_inertia_circuit"],
    "calibrate": ["creep_2000V"],
    "validate": [],
    "preparation": {
        "creep": [
            {"delay": {}},
            {"baseline": {}},
            {"excitation_knots": {"tolerance": "2 V"}},
            {"average": {"grid": "uniform", "width": "2 ms"}},
        ]
    },
}
MEMBRANE = {
    "specimen": "data/membrane",
    "candidates": ["kv_gm_1"],
    "calibrate": ["step_4kV"],
    "validate": [],
    "preparation": {
        "step": [
            {"baseline": {"response": "displacement"}},
            {"mask_before": {"time": "0.5 s", "from_step": True}},
            {"average": {**COARSE, "first_width": "0.5 s", "widest": "60 s"}},
            {"excitation_knots": {"tolerance": "2 V"}},
        ]
    },
}
STRUCTURE = {
    "specimen": "data/minimum_energy_structure",
    "candidates": ["ogden_2"],
    "calibrate": ["quasi_static_0kV", "quasi_static_5kV"],
    "validate": [],
}
STRIP = {"specimen": "data/strip", "candidates": ["ogden_1_units_3"]}
STRIP_TRUTH = {
    "mu_1": -11e3, "alpha_1": -3.8, "tau_1": 0.4, "tau_2": 7.0, "tau_3": 600.0,
    "mu_beta_1": 130e3, "mu_beta_2": 40e3, "mu_beta_3": 15e3,
}  # fmt: skip
STRIP_SPECIMEN = {
    "name": "strip",
    "system": "tensile_strip",
    "provenance": {"kind": "simulated", "source": "ogden_1_units_3"},
    "quantities": {
        "gauge_length": {"value": 80, "unit": "mm"},
        "cross_section": {"value": 22, "unit": "mm^2"},
    },
}


def fitted(study: str, settings: dict[str, Any], results: str = "results") -> Path:
    """The posterior of a study's first candidate, sampled for a moment."""
    config = {"studies": {study: settings}, "sampling": SAMPLING}
    Path("config.yaml").write_text(yaml.safe_dump(config))
    candidate = settings["candidates"][0]
    fit_by_name(study, candidate, Path("config.yaml"), Path(results))
    return Path(results) / study / candidate / "posterior.nc"


def strip_posterior() -> None:
    """A fit of a simulated relaxation in the place of the public records."""
    folder = Path("data/strip")
    (folder / "records").mkdir(parents=True)
    (folder / "specimen.yaml").write_text(yaml.safe_dump(STRIP_SPECIMEN))
    (folder / "experiments.csv").write_text(
        "name,protocol,record,role,excitation,response\n"
        "hold,relaxation,records/hold.csv,calibrate,displacement,force\n"
    )
    time = np.concatenate([np.arange(0.0, 5.0, 0.1), np.geomspace(5.0, 1800.0, 100)])
    displacement = 0.08 * np.clip(time / 4.0, 0.0, 1.0)
    given = {name: entry | {} for name, entry in STRIP_SPECIMEN["quantities"].items()}
    force = deabayes.simulate(
        "tensile_strip", "ogden_1_units_3", STRIP_TRUTH, given, time, "force",
        displacement=displacement,
    )["force"].values  # fmt: skip
    noisy = force + 2e-3 * np.random.default_rng(1).standard_normal(time.size)
    np.savetxt(
        folder / "records/hold.csv", np.column_stack([time, displacement, noisy]), "%.6g", ",",
        header="time [s],displacement [m],force [N]", comments="",
    )  # fmt: skip
    fitted("vhb4910", STRIP)


def membrane_posterior() -> None:
    """One unit in the place of three."""
    made = fitted("membrane", MEMBRANE)
    made.parent.rename(made.parent.with_name("kv_gm_3"))


def full_posterior() -> None:
    """One unit in the place of two."""
    made = fitted("tubular_full", FULL)
    made.parent.rename(made.parent.with_name("voigt_kelvin_2_inertia_circuit"))


MADE_BY = {
    "tubular": lambda: fitted("tubular", QUICK, "results/quick"),
    "membrane": membrane_posterior,
    "minimum_energy_structure": lambda: fitted("minimum_energy_structure", STRUCTURE),
    "tensile_strip": strip_posterior,
    "control": full_posterior,
}
MADE_BY["reuse"] = MADE_BY["tubular"]


@pytest.fixture(scope="module")
def made() -> dict[Any, Path]:
    return {}


@pytest.fixture
def project(
    request: pytest.FixtureRequest,
    made: dict[Any, Path],
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Path]:
    """A project's folder with the shipped data and one posterior; the working directory."""
    make = MADE_BY[request.param]
    folder = made.get(make) or tmp_path_factory.mktemp(request.param)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    if make not in made:
        (folder / "data").mkdir()
        for study in ("tubular", "membrane", "minimum_energy_structure"):
            (folder / "data" / study).symlink_to(ROOT / "data" / study)
        make()
        made[make] = folder
    backend = mpl.get_backend()
    mpl.use("Agg")
    yield folder
    plt.close("all")
    mpl.rcdefaults()
    mpl.use(backend)


@pytest.mark.parametrize(
    ("project", "notebook"), [(path.stem, path) for path in NOTEBOOKS], indirect=["project"]
)
def test_a_notebook_runs(
    project: Path,
    notebook: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = project / "docs/notebooks"
    place.mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(place)
    known: dict[str, Any] = {}
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    drawn = 0
    for cell in (cell for cell in cells if cell["cell_type"] == "code"):
        exec(compile("".join(cell["source"]), notebook.name, "exec"), known)
        drawn += len(plt.get_fignums())
        plt.close("all")
    stored = [output for cell in cells for output in cell.get("outputs", [])]
    assert drawn == sum("image/png" in output.get("data", {}) for output in stored)
    assert capsys.readouterr().out.strip()
    assert list(place.iterdir()) == []  # what it writes goes elsewhere


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_outputs_are_of_one_run(notebook: Path) -> None:
    content = json.loads(notebook.read_text("utf-8"))
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert outputs and not [o for o in outputs if o["output_type"] == "error"]
    assert notebook.stat().st_size < 120_000


def blocks(language: str) -> str:
    """The code of the tutorial in one language; commands have none."""
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", TUTORIAL, re.DOTALL | re.MULTILINE)
    return "".join(text for name, text in fences if name == language)


@pytest.mark.parametrize("project", ["tubular"], indirect=True)
def test_the_python_of_the_tutorial_runs(project: Path) -> None:
    known: dict[str, Any] = {}
    exec(compile(blocks("python"), "tutorial.md", "exec"), known)
    assert known["prediction"].attrs["extrapolation"] == ""


def test_the_tutorial_names_what_make_quick_makes(tmp_path: Path) -> None:
    jobs = planned(tmp_path, "--workflow-profile", ROOT / "workflow/profiles/quick")
    assert {"fit tubular voigt_kelvin_1", "fit tubular voigt_kelvin_2", "report"} <= jobs
    made_by = {
        "report/index.html": "report",
        "tubular/figures": "figures tubular",
        "tubular/comparison.csv": "compare tubular",
        "tubular/further_experiments.csv": "further_experiments tubular",
        "tubular/voigt_kelvin_1/errors.csv": "predict tubular voigt_kelvin_1",
        "tubular/voigt_kelvin_2/summary.csv": "fit tubular voigt_kelvin_2",
        "tubular/voigt_kelvin_2/posterior.nc": "fit tubular voigt_kelvin_2",
    }
    named = set(re.findall(r"results/quick/([\w./]+\w)", TUTORIAL))
    assert named == set(made_by)
    assert set(made_by.values()) <= jobs


def test_the_commands_of_the_tutorial_are_accepted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [shlex.split(line, comments=True) for line in blocks("").splitlines()]
    monkeypatch.chdir(ROOT)
    targets = re.findall(r"^(\w+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for program, *arguments in lines:
        match program:
            case "make":
                assert set(arguments) <= set(targets)
            case "source":
                assert arguments == [".venv/bin/activate"]
            case "snakemake":
                jobs = planned(tmp_path, *arguments[2:], "--configfile", ROOT / "config.yaml")
                assert "fit tubular_full voigt_kelvin_3_inertia_circuit" in jobs
            case "deabayes" if arguments[0] == "check":
                main(arguments)
            case "deabayes":
                main([arguments[0], "--help"])
    said = capsys.readouterr().out
    _, record, printed = blocks("text").partition("creep_2000V: ")
    for line in (record + printed).splitlines():
        assert line in said
    for path in re.findall(r"`(data/[\w./]+)`", TUTORIAL):
        assert Path(path).exists()
