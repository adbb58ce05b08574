"""What is no fault of a study folder, and faults that are said once only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.breaks import column, specimen, table, voltage
from tests.shared.study_folders import faults_of, make_folder

from deabayes.experiment import Specimen
from deabayes.faults import Faults
from deabayes.records.checks import check_record
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import read_folder


@pytest.mark.parametrize(
    ("unit", "volts", "column", "stated"),
    [
        ("kV", "2.0", "voltage_kV", "2.1"),
        ("V", "2000", "amplitude_kV", "1"),
        ("V", "2.0", "voltage_kV", "0"),
        ("V", "nan", "voltage_kV", "2"),
    ],
)
def test_voltages_that_agree_with_their_row(
    tmp_path: Path, unit: str, volts: str, column: str, stated: str
) -> None:
    folder = make_folder(tmp_path)
    voltage(unit, volts, column, stated)(folder)
    read_folder(folder)


def test_a_constant_response_is_one_fault(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    column(2, "0.5")(folder)
    (fault,) = faults_of(folder)
    assert "column force: is constant" in fault


def test_an_excitation_of_zeros_is_one_fault() -> None:
    """That it is constant; that its row says another voltage is no second one."""
    columns = {"time": np.arange(9.0), "voltage": np.zeros(9), "displacement": np.arange(9.0)}
    raw = RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)
    said = {"voltage_kV": 3.0}
    row = ExperimentRow("a", "creep", "a.csv", "calibrate", "voltage", "displacement", said)
    (fault,) = check_record(row, raw, Specimen("film", "membrane", {}, {}), "a.csv").faults
    assert "column voltage: is constant (0 in all" in fault


@pytest.mark.parametrize(("newton", "refused"), [(1.13, False), (1.09, True)])
def test_a_clipped_sensor_may_read_five_per_cent_beyond_its_range(
    tmp_path: Path, newton: float, refused: bool
) -> None:
    folder = make_folder(tmp_path)  # forces up to 1.167 N
    specimen("range: {value: 10, unit: N}", f"range: {{value: {newton}, unit: N}}")(folder)
    faults = faults_of(folder)
    assert len(faults) == 2 * refused  # both records
    assert all("column force: reaches 1.16" in fault for fault in faults)


def test_a_row_given_twice_is_said_once(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    table("pull,load_unload,records/pull.csv", "relax,load_unload,records/relax.csv")(folder)
    with pytest.raises(Faults) as caught:
        read_folder(folder)
    assert len(caught.value.faults) == 1
