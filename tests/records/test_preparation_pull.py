"""Quasi-static pulls on an actuator: their voltage reaches the system as a condition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Quantity, Specimen
from deabayes.faults import Faults
from deabayes.records.checks import checked
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare

STRIP = Specimen("strip", "tensile_strip", {"kind": "simulated"}, {})


AMPLIFIER = replace(STRIP, instruments={"voltage.range": Quantity(5e3, "V")})


def pull(
    voltage: FloatArray | None = None, specimen: Specimen = STRIP, **metadata: object
) -> Experiment:
    """An outward force at a held voltage against a slider's displacement, downwards first."""
    travel = np.linspace(0.01, 0.0, 21)
    columns = {"displacement": travel, "force": 5.0 - 300.0 * travel}
    if voltage is not None:
        columns["voltage"] = voltage
    units = {"displacement": "m", "force": "N", "voltage": "V"}
    row = ExperimentRow(
        "a", "quasi_static", "a.csv", "calibrate", "displacement", "force", metadata
    )  # type: ignore[arg-type]
    raw = checked(row, RawRecord(columns, units, "cd" * 32), specimen)
    return prepare(row, raw, specimen)


@pytest.mark.parametrize(
    ("level", "metadata", "volts"),
    [
        (None, {"voltage_kV": 4.5}, 4500.0),
        (None, {"voltage_kV": 0.0}, 0.0),
        (3000.0, {"voltage_kV": 4.5}, 3000.0),  # the column has the say
        (3000.0, {}, 3000.0),
        (0.0, {"voltage_kV": 0.0}, 0.0),
        (0.0, {}, 0.0),  # a monitor's noise about zero is no variation
        (None, {}, None),
    ],
)
def test_a_pull_hands_on_its_voltage(
    level: float | None, metadata: dict[str, object], volts: float | None
) -> None:
    monitor = 0.3 * np.random.default_rng(2).standard_normal(21)
    experiment = pull(None if level is None else level + monitor, **metadata)
    assert experiment.coordinate_name == experiment.excitation.name == "displacement"
    assert np.all(np.diff(experiment.coordinate) > 0.0)
    assert experiment.response == pytest.approx(5.0 - 300.0 * experiment.coordinate)
    if volts is None:
        assert "voltage" not in experiment.excitation.conditions
    else:
        assert experiment.excitation.conditions["voltage"] == pytest.approx(volts, abs=0.3)


@pytest.mark.parametrize(
    ("voltage", "metadata", "message"),
    [
        (np.linspace(3000.0, 3031.0, 21), {}, "varies from 3000 to 3031 V during the pull; give"),
        (np.linspace(0.0, 10.5, 21), {}, "varies from 0 to 10.5 V"),
        (np.append(np.full(20, 3000.0), np.nan), {}, "column voltage: values missing, NaN"),
        (None, {"voltage_kV": "3 kV"}, "voltage_kV is '3 kV' in experiments.csv; give a number"),
        (None, {"voltage_kV": np.nan}, "voltage_kV is nan"),
        (np.zeros(21), {"voltage_kV": 3.0}, "comes to 0 V where experiments.csv says voltage_kV 3"),
    ],
)
def test_a_voltage_that_is_not_held_is_refused(
    voltage: FloatArray | None, metadata: dict[str, object], message: str
) -> None:
    with pytest.raises(Faults) as error:
        pull(voltage, **metadata)
    assert "a.csv (a)" in str(error.value)
    assert message in str(error.value)
    assert len(error.value.faults) == 1


@pytest.mark.parametrize(
    ("voltage", "metadata", "message"),
    [
        (None, {"voltage_kV": 3000.0}, "voltage_kV is 3000 in experiments.csv, beyond the voltage"),
        (np.full(21, 3e6), {}, "column voltage: reaches 3000 kV, beyond the instrument's range"),
    ],
)
def test_a_voltage_that_no_amplifier_holds_is_refused(
    voltage: FloatArray | None, metadata: dict[str, object], message: str
) -> None:
    with pytest.raises(Faults) as error:
        pull(voltage, AMPLIFIER, **metadata)
    (fault,) = error.value.faults
    assert message in fault and "range of 5 kV" in fault
    assert pull(np.full(21, 5e3), AMPLIFIER, voltage_kV=5.0).warnings == ()
