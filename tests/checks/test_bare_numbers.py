"""Numbers without a unit in preparation steps and priors are read as SI, with a warning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from tests.shared.strip_records import curve, prepared, relaxation
from tests.shared.study_folders import make_folder, replace_in

from deabayes.checks.study import check_study
from deabayes.faults import Report
from deabayes.study import Study


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ({"mask_before": {"time": 1}},
         ["mask_before.time: 1 without a unit is 1 s; write '1 s' if that is meant"]),
        ({"excitation_knots": {"tolerance": 0.001}},
         ["excitation_knots.tolerance: 0.001 without a unit is 0.001 m; write '0.001 m' if that "
          "is meant"]),
        ({"mask_ramp_end": {"before": 0.1, "after": "0.3 s", "at": 3.0}},
         ["mask_ramp_end.at: 3.0 without", "mask_ramp_end.before: 0.1 without"]),
        ({"crop": {"from": 0, "to": 10.0, "from_step": True}}, ["crop.to: 10.0 without a unit"]),
        ({"mask_before": {"time": "1 s"}}, []),
        ({"average": {"ratio": 1.2, "largest_change": 0.1}}, []),
        ({"average": {"grid": "uniform", "points": 50}}, []),
        ({"decimate": {"every": 2}}, []),
        ({"scale": {"by": -1}}, []),
        ({"excitation_knots": {"fraction": 0.01}}, []),
    ],
)  # fmt: skip
def test_quantities_without_a_unit_are_noted(step: Mapping[str, object], said: list[str]) -> None:
    report = Report()
    prepared(relaxation(end=20.0), step, bare_numbers=report)
    lines = report.warnings
    assert len(lines) == len(said)
    for line, start in zip(lines, said, strict=True):
        assert line.startswith(f"preparation.relaxation, {start}")


def test_a_place_on_a_coordinate_without_a_unit_is_plain() -> None:
    report, stretch = Report(), np.linspace(1.0, 3.0, 20)
    curve(stretch, stretch, {"mask_before": {"time": 1.2}}, bare_numbers=report)
    assert report.warnings == []


def test_check_says_it_once_for_all_records_of_a_protocol(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "pull,load_unload", "pull,relaxation")
    steps = ({"mask_before": {"time": 0.5}}, {"mask_after": {"time": "3.5 s"}})
    study = Study("s", folder, ("kv_gm_1",), preparation={"relaxation": steps})
    report = check_study(study)
    assert report.faults == []
    assert [line for line in report.warnings if "without a unit" in line] == [
        "study s, preparation.relaxation, mask_before.time: 0.5 without a unit is 0.5 s; write "
        "'0.5 s' if that is meant"
    ]


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("mu_alpha", {"distribution": "lognormal", "median": 35, "sigma": 0.5},
         ["study s, priors.mu_alpha.median: 35 without a unit is 35 Pa; write '35 Pa' if that is "
          "meant"]),
        ("mu_alpha", {"distribution": "lognormal", "median": "35", "sigma": 0.5},
         ["study s, priors.mu_alpha.median: 35 without a unit is 35 Pa; write '35 Pa' if that is "
          "meant"]),
        ("mu_alpha", {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}, []),
        ("J_alpha", {"distribution": "lognormal", "median": 50, "sigma": 0.5}, []),
        ("tau_beta", {"distribution": "loguniform", "lower": 2, "upper": "9 s"},
         ["study s, priors.tau_beta.lower: 2 without a unit is 2 s; write '2 s' if that is meant"]),
        ("tau_beta", {"distribution": "loguniform", "lower": "1 s", "upper": "9 s",
                      "minimum_ratio": 3}, []),
    ],
)  # fmt: skip
def test_a_prior_without_a_unit_is_a_warning(
    tmp_path: Path, name: str, settings: dict[str, object], said: list[str]
) -> None:
    study = Study("s", make_folder(tmp_path), ("kv_gm_1", "kv_gm_2"), priors={name: settings})
    report = check_study(study)
    assert report.faults == []
    assert [warning for warning in report.warnings if "without a unit" in warning] == said
