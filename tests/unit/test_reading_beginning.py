"""What an excitation was before its record."""

from __future__ import annotations

import pytest

from deabayes.reading.beginning import value_before
from deabayes.reading.raw import ExperimentRow


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
