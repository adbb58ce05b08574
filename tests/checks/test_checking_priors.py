"""What check says of the priors that a study writes down."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder

from deabayes.checks.study import check_study
from deabayes.study import Study


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
    ],
)  # fmt: skip
def test_a_number_without_a_unit_is_a_warning(
    tmp_path: Path, name: str, settings: dict[str, object], said: list[str]
) -> None:
    study = Study("s", make_folder(tmp_path), ("kv_gm_1", "kv_gm_2"), priors={name: settings})
    report = check_study(study)
    faults, warnings = report.faults, report.warnings
    assert faults == []
    assert [warning for warning in warnings if "without a unit" in warning] == said
