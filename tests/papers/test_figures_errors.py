"""Errors that differ much are told apart: on a logarithmic axis beyond a factor of 20."""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures.results import StudyResults
from deabayes.papers.minimum_energy_structure import structure_errors

FACTORS = [(15.0, "linear"), (100.0, "log")]


@pytest.mark.parametrize(("factor", "scale"), FACTORS)
def test_errors_of_two_candidates(factor: float, scale: str, tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(candidates=(1, 2)))
    for path, value in zip(sorted(study.glob("*/errors.csv")), (0.2, 0.2 * factor), strict=True):
        table = pd.read_csv(path)
        table[["e_rms_percent", "e_rms_q05", "e_rms_q95"]] = [value, 0.9 * value, 1.5 * value]
        table.to_csv(path, index=False)
    (figure,) = figures.draw("errors", StudyResults(study))
    for ax in figure.axes:
        assert ax.get_xscale() == scale
        low, high = ax.get_xlim()
        assert low < 0.18 and high > 0.3 * factor


@pytest.mark.parametrize(("factor", "scale"), FACTORS)
def test_errors_of_sines_of_a_structure(factor: float, scale: str) -> None:
    table = pd.DataFrame({"candidate": ["a", "b"], "converged": True, "frequency_Hz": 1.0})
    for voltage in ("4kV", "5kV"):
        table[f"role_{voltage}"] = "validate"
        for end, part in (("percent", 1.0), ("q05", 0.9), ("q95", 1.5)):
            table[f"e_rms_{voltage}_{end}"] = [0.2 * part, 0.2 * part * factor]
        table[f"paper_e_rms_{voltage}_percent"] = 0.2
    found = SimpleNamespace(tables={"table_5_errors": table})
    (figure,) = structure_errors.draw(None, found)  # type: ignore[arg-type]
    for ax in figure.axes:
        assert ax.get_yscale() == scale
        low, high = ax.get_ylim()
        assert low < 0.18 and high > 0.3 * factor
