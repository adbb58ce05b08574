"""Turning a sign, and steps that are for one record or one response only."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.strip_records import STRIP, prepared, relaxation

from deabayes.faults import UserError
from deabayes.records.columns import ExperimentRow
from deabayes.records.preparation import prepare
from deabayes.records.preparation.defaults import misaddressed

RECORD = relaxation(end=20.0)
FORCE = RECORD.columns["force"]


@pytest.mark.parametrize(
    ("settings", "factor"),
    [
        ({"by": -1}, -1.0),
        ({"by": "2.5"}, 2.5),
        ({"by": -1, "response": "force", "record": "a"}, -1.0),
        ({"by": -1, "response": "displacement"}, 1.0),
        ({"by": -1, "record": "b"}, 1.0),
    ],
)
def test_the_response_is_multiplied(settings: dict[str, object], factor: float) -> None:
    experiment = prepared(RECORD, {"scale": settings})
    np.testing.assert_array_equal(experiment.response, factor * FORCE)
    assert experiment.steps[-1]["step"] == "scale"


def test_a_record_may_be_called_by_a_number() -> None:
    row = ExperimentRow("7", "relaxation", "a.csv", "calibrate", "displacement", "force", {})
    experiment = prepare(row, RECORD, STRIP, [{"scale": {"by": -1, "record": 7}}])
    np.testing.assert_array_equal(experiment.response, -FORCE)


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ({"scale": {}}, r"scale: needs 'by'"),
        ({"scale": {"by": 0}}, r"scale\.by: 0 leaves nothing"),
        ({"scale": {"by": "2 N"}}, r"scale\.by"),
        ({"scale": {"factor": 2}}, r"unknown setting 'factor'"),
        ({"mask_between": {"from": "5 s"}}, r"mask_between: needs 'to'"),
        ({"mask_between": {"from": "5 s", "to": "4 s"}}, r"must lie behind"),
    ],
)
def test_mistakes_are_said(step: dict[str, object], said: str) -> None:
    with pytest.raises(UserError, match=said):
        prepared(RECORD, step)


ROWS = [
    ExperimentRow("pull", "relaxation", "a.csv", "calibrate", "stretch", "force", {}),
    ExperimentRow("7", "relaxation", "a.csv", "calibrate", "stretch", "force", {}),
    ExperimentRow("shake", "frequency_response", "b.csv", "calibrate", "frequency", "gain", {}),
]


@pytest.mark.parametrize(
    ("protocol", "settings", "said"),
    [
        ("relaxation", {"record": "pul"}, "preparation.relaxation, scale.record: no relaxation "
         "record has the name 'pul'; did you mean 'pull'?"),
        ("relaxation", {"record": "shake"}, "no relaxation record has the name 'shake'"),
        ("relaxation", {"response": "gain"}, "no relaxation record has the response 'gain'"),
        ("relaxation", {"record": ["pull"]}, "scale.record: expected one record, found ['pull']; "
         "write the step once for each"),
        ("relaxation", {"response": {"is": "force"}}, "expected one response, found"),
        ("relaxation", {"record": 7}, ""),
        ("relaxation", {"record": 8}, "no relaxation record has the name '8'"),
        ("relaxation", {"record": "pull", "response": "force"}, ""),
        ("frequency_response", {"record": "shake_phase", "response": "phase"}, ""),
        ("load_unload", {"record": "pull"}, ""),
        ("relaxation", None, ""),
    ],
)  # fmt: skip
def test_a_step_for_a_record_that_there_is_not(
    protocol: str, settings: dict[str, object] | None, said: str
) -> None:
    faults = misaddressed({protocol: ["average", {"scale": settings}]}, ROWS)
    assert len(faults) == bool(said)
    assert all(said in fault for fault in faults)
