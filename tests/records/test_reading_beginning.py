"""What an excitation was before its record."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.experiment import Specimen
from deabayes.records.channels import value_before
from deabayes.records.checks import check_record
from deabayes.records.columns import ExperimentRow, RawRecord

TIME = 0.01 * np.arange(400)
SINE = np.sin(2.0 * np.pi * TIME)
RAMP = np.clip(TIME, 0.0, 1.0)
UNITS = {"voltage": "V", "control_voltage": "V", "stretch": "1", "displacement": "m"}
SETTLED = {"prehistory": "equilibrium"}


def beginning(
    system: str,
    values: np.ndarray,
    excitation: str = "voltage",
    protocol: str = "sine",
    said: dict[str, float | str] | None = None,
) -> list[str]:
    """What is warned of how an excitation begins."""
    columns = {"time": TIME, excitation: values, "displacement": TIME + 0.1 * np.sin(9.0 * TIME)}
    units = {"time": "s", **UNITS}
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", excitation, "displacement", said or {})
    raw = RawRecord(columns, units, "ab" * 32)
    found = check_record(row, raw, Specimen("film", system, {}, {}), "a.csv (a)").warnings
    return [warning for warning in found if "first sample" in warning]


@pytest.mark.parametrize(
    ("system", "excitation", "prehistory", "before"),
    [
        ("membrane", "voltage", None, 0.0),
        ("tubular", "control_voltage", None, 0.0),
        ("minimum_energy_structure", "voltage", "rest", 0.0),
        ("minimum_energy_structure", "voltage", "equilibrium", None),
        ("minimum_energy_structure", "control_voltage", "equilibrium", None),
        ("membrane", "voltage", "equilibrium", 0.0),  # which it knows nothing of
        ("unknown", "voltage", "equilibrium", 0.0),
        ("tensile_strip", "stretch", None, None),
    ],
)
def test_a_voltage_was_off_and_what_else_there_is_as_in_the_first_sample(
    system: str, excitation: str, prehistory: str | None, before: float | None
) -> None:
    said = {} if prehistory is None else {"prehistory": prehistory}
    row = ExperimentRow("a", "sine", "a.csv", "calibrate", excitation, "displacement", said)
    assert value_before(row, system) == before


@pytest.mark.parametrize("protocol", ["sine", "sweep", "step", "creep", "own"])
@pytest.mark.parametrize("excitation", ["voltage", "control_voltage"])
def test_a_voltage_that_is_not_off_at_first_is_said_to_jump(excitation: str, protocol: str) -> None:
    """It was taken for a jump from rest without a word."""
    (warning,) = beginning("membrane", 2000.0 + 1000.0 * RAMP, excitation, protocol)
    assert warning.startswith(f"a.csv (a): {excitation} begins with 2 kV and is assumed")
    assert "if it was on before the record, add the rows since then" in warning
    assert "prehistory" not in warning, "a membrane has none"


@pytest.mark.parametrize("excitation", ["voltage", "control_voltage"])
def test_a_structure_may_have_settled_before(excitation: str) -> None:
    system, biased = "minimum_energy_structure", 500.0 + 400.0 * SINE
    (warning,) = beginning(system, biased, excitation)
    assert warning.endswith("state `prehistory: equilibrium` in experiments.csv")
    assert beginning(system, biased, excitation, said=SETTLED) == []
    assert len(beginning("tubular", biased, excitation, said=SETTLED)) == 1


@pytest.mark.parametrize(("first", "said"), [(50.0, 0), (-50.0, 0), (70.0, 1), (-70.0, 1)])
def test_a_monitors_offset_is_no_jump(first: float, said: int) -> None:
    """Up to 2 % of the largest voltage, here 3 kV."""
    values = np.where(TIME < 1.0, first, 3000.0)
    assert len(beginning("membrane", values, protocol="step")) == said


def test_a_step_from_the_start_is_said_to_be_one() -> None:
    (warning,) = beginning("membrane", np.full(400, 3000.0), protocol="step")
    assert "voltage is constant, so the step is taken to happen at the first sample" in warning


def test_a_strip_that_was_stretched_before_had_relaxed() -> None:
    assert beginning("tensile_strip", 1.5 + 0.1 * SINE, "stretch") == []


def test_what_has_no_time_has_no_beginning() -> None:
    assert beginning("membrane", 2000.0 + 1000.0 * SINE, protocol="quasi_static") == []
