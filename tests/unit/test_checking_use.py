"""What a folder or a study holds that nothing can use."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.study_folders import make_folder, replace_in

from deabayes.checks.folder import check_folder
from deabayes.checks.study import check_study
from deabayes.study import Study


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("specimen.yaml", "  gauge_length: {value: 80, unit: mm, source: ruler}\n", "",
         "(relax): specimen 'strip A' lacks gauge_length, which a displacement needs"),
        ("experiments.csv", "stretch_rate_per_s\n", "deformation\n",
         "(pull): unknown deformation '0.05'"),
    ],
)  # fmt: skip
def test_a_record_that_no_candidate_predicts(
    tmp_path: Path, name: str, old: str, new: str, said: str
) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / name, old, new)
    (fault,) = check_folder(folder).faults
    assert said in fault
    assert "experiments.csv" in fault


def test_steps_that_no_record_takes_are_a_warning(tmp_path: Path) -> None:
    steps = {"sine": [{"decimate": {"every": 2}}]}
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), preparation=steps)
    faults, warnings = check_study(study)
    assert not faults
    assert "preparation.sine: no record of the study is of this protocol" in warnings[0]
