"""The page of two made-up studies, which several tests read."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.report import build

UNCONVERGED = Fake(
    name="fake_tube",
    provenance="simulated",
    converged=False,
    candidates=(1,),
    protocols=("creep", "sine", "sine"),
    extrapolation="voltage 0 to 3500 V lies outside the calibrated 0 to 2500 V",
    correlated_noise=8e3,
    warnings=("3 gaps in the sampling",),
)
LEFT_OUT = "silicones: the records are not here; set DEABAYES_DATA <folder>"


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("results")
    protocols = ("relaxation", "load_unload")
    studies = [
        write_study(folder, Fake(candidates=(1, 2), protocols=protocols)),
        write_study(folder, UNCONVERGED),
    ]
    output = folder / "report" / "index.html"
    few = {name: figures.REGISTRY[name] for name in ("data_and_bands", "marginals", "errors")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "REGISTRY", few)
        assert build(studies, output, folder / "report" / "tables", [LEFT_OUT]) == output
    return output.read_text(encoding="utf-8"), folder / "report" / "tables"
