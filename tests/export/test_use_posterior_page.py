"""docs/how-to/use-posterior.md does what it says: its Python runs, its commands are accepted."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from tests.posteriors.test_predict_with import STUDY, file, prior_of_the_rest

from deabayes.cli.main import main
from deabayes.posteriors.storage import write_tree

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "use-posterior.md").read_text("utf-8")
CODE = re.compile(r"```python\n(.*?)```", re.DOTALL)
COMMANDS = re.compile(r"```\n(deabayes.*?)```", re.DOTALL)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    study = replace(STUDY, specimen=ROOT / "data" / "tubular")
    folder = tmp_path / "results" / "tubular" / "voigt_kelvin_2"
    folder.mkdir(parents=True)
    write_tree(file(prior_of_the_rest(), study), folder / "posterior.nc")
    (tmp_path / "data").symlink_to(ROOT / "data")
    (tmp_path / "drive.csv").write_text("time [ms],voltage [kV]\n0,0\n10,1.8\n500,1.8\n")
    (tmp_path / "frequencies.csv").write_text("frequency [Hz]\n10\n20\n40\n")
    return tmp_path


def test_the_python_runs(place: Path) -> None:
    before = mpl.get_backend()
    mpl.use("Agg")
    known: dict[str, object] = {}
    for block in CODE.findall(PAGE):
        exec(compile(block, "use-posterior.md", "exec"), known)
    mpl.use(before)
    held, gain = known["held"], known["gain"]
    assert held["excitation"].values.tolist() == [1800.0] * 500  # type: ignore[index]
    assert gain.attrs["model_note"].startswith("solved by voigt_kelvin_2_inertia_circuit")  # type: ignore[attr-defined]
    assert known["own"]["excitation"].values.tolist() == [0.0, 1800.0, 1800.0]  # type: ignore[index]
    assert {"band.png", "band.csv", "band.nc"} <= {path.name for path in place.iterdir()}


def test_the_commands_run(place: Path) -> None:
    blocks = "".join(COMMANDS.findall(PAGE)).replace("\\\n", " ")
    commands = [shlex.split(line)[1:] for line in blocks.splitlines()]
    assert [command[0] for command in commands] == ["predict", "predict", "simulate"]
    for command in commands:
        main(command)
    assert "parameter_90_lower [1]" in pd.read_csv("prediction.csv")
    assert "gain_median [1/V]" in pd.read_csv("gain.csv")
    assert "strain [1]" in pd.read_csv("response.csv")
