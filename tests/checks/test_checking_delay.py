"""A delay that specimen.yaml states and a study's own preparation leaves in is said."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.records.test_measured_rows import folder as shaken
from tests.shared.study_folders import make_folder, replace_in

from deabayes.checks.study import check_study
from deabayes.study import Study

HIDE = {"mask_before": {"time": "0.1 s"}}


def said(
    tmp_path: Path, delay: str, steps: list[object] | None, protocol: str = "relaxation"
) -> list[str]:
    """What is said of a strip's record of this protocol."""
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "instruments:", f"instruments:\n  {delay}")
    replace_in(folder / "experiments.csv", "relaxation", protocol)
    candidate = "gent" if protocol == "quasi_static" else "kv_gm_1"
    return warned(folder, candidate, {} if steps is None else {protocol: steps})


def warned(folder: Path, candidate: str, preparation: dict[str, list[object]]) -> list[str]:
    """What is said of delays; the held-out pull has its usual steps."""
    study = Study(
        "s",
        folder,
        (candidate,),
        validate=(),
        preparation=preparation,  # type: ignore[arg-type]
    )
    report = check_study(study)
    assert report.faults == []
    return [warning for warning in report.warnings if "delay" in warning]


@pytest.mark.parametrize("steps", [[], [HIDE]])
def test_steps_without_it(tmp_path: Path, steps: list[object]) -> None:
    """It was passed over without a word."""
    (warning,) = said(tmp_path, "delay: {value: 20, unit: ms}", steps)
    assert warning.startswith("study s, preparation.relaxation: the force's delay of 20 ms, stated")
    assert "add `delay: {}` as the first of them" in warning


@pytest.mark.parametrize(
    ("delay", "steps"),
    [
        ("delay: {value: 20, unit: ms}", None),
        ("delay: {value: 20, unit: ms}", [{"delay": {}}, HIDE]),
        ("delay: {value: 20, unit: ms}", ["delay"]),
        ("delay: {value: 0, unit: ms}", [HIDE]),
        ("nominal_stress: {delay: {value: 20, unit: ms}}", [HIDE]),
    ],
)
def test_nothing_is_left_in(tmp_path: Path, delay: str, steps: list[object] | None) -> None:
    assert said(tmp_path, delay, steps) == []


def test_what_has_no_time_has_no_delay(tmp_path: Path) -> None:
    steps = [{"decimate": {"every": 2}}]
    assert said(tmp_path, "delay: {value: 20, unit: ms}", steps, "quasi_static") == []


def test_of_a_frequency_response_the_phase_has_it(tmp_path: Path) -> None:
    """The gain of the same record has none."""
    path = shaken(tmp_path, more="instruments: {delay: {value: 4, unit: ms}}\n")
    (warning,) = warned(path, "voigt_kelvin_1_inertia", {"frequency_response": []})
    assert "preparation.frequency_response: the phase's delay of 4 ms" in warning
    assert warned(path, "voigt_kelvin_1_inertia", {}) == []
