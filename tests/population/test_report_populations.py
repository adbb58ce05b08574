"""The report's section on a population: units of its spread, notices of its predictions."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study
from tests.shared.populations import parameter

from deabayes.figures.results import StudyResults
from deabayes.population.coordinate import Coordinate
from deabayes.population.member import Member
from deabayes.population.model import PopulationModel
from deabayes.prior.distributions import LogNormal, Normal, Uniform
from deabayes.prior.joint import Prior
from deabayes.report import notices, tables


def test_only_a_spread_of_the_logarithm_is_relative() -> None:
    prior = Prior(
        [
            parameter("mu", LogNormal(1e4, 1.0)),
            parameter("alpha", Normal(0.0, 3.0), "1"),
            parameter("share", Uniform(0.1, 1.0), "1"),
        ]
    )
    rng = np.random.default_rng(1)
    coordinate = Coordinate.of(prior.parameters)
    member = Member.of("strip", prior.sample(rng, 2000), prior, coordinate, 2000)
    model = PopulationModel.of(coordinate, [member])
    labels = {p.name: {"unit": p.unit, "symbol": p.symbol, "description": p.description}
              for p in (*prior.parameters, *model.prior.parameters)}  # fmt: skip
    numbers = {"median": 0.3, "q05": 0.2, "q95": 0.4}
    summary = pd.DataFrame({name: numbers | {"unit": labels[name]["unit"]} for name in labels}).T
    results = SimpleNamespace(summary=summary, new_specimen=SimpleNamespace(label=labels.get))
    rows = [tables._population_parameter(results, name) for name in coordinate.names]  # type: ignore[arg-type]
    assert [row["spread_unit"] for row in rows] == ["%", "", "%"]
    assert [row["spread"] for row in rows] == ["30 [20, 40]", "0.30 [0.20, 0.40]", "30 [20, 40]"]


@pytest.mark.parametrize("failed", [0, 3])
def test_a_new_specimens_predictions_have_their_notices(tmp_path: Path, failed: int) -> None:
    """A new specimen may fail where none of the measured ones did."""
    extrapolation = "stretch 1 to 3 lies outside the calibrated 1 to 2"
    fake = Fake(candidates=(1,), protocols=3 * ("relaxation",), extrapolation=extrapolation)
    new = StudyResults(write_study(tmp_path, fake)).recommended
    for prediction in new.predictions.values():
        prediction.attrs["failed_draws"] = failed
    results = SimpleNamespace(
        name="strips", attributes={"candidate": "kv_gm_1"}, converged=True, new_specimen=new
    )
    found = notices.of_population(results)  # type: ignore[arg-type]
    titles = [notice.title for notice in found]
    assert any("Extrapolation" in title for title in titles)
    assert ("Failed predictions" in titles) == bool(failed)
    assert {(notice.study, notice.candidate) for notice in found} == {("strips", "kv_gm_1")}
