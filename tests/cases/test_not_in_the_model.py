"""What changes over the records and no model knows of is a fault, or a named choice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cases.study_folder import check, made, row

STRIP = {"cross_section": (10.0, "mm^2"), "gauge_length": (50.0, "mm")}
TIME = np.linspace(0.0, 10.0, 200)
STRETCH = 2.0 - np.abs(TIME - 5.0) / 5.0


def pull(volts: float, column: bool) -> dict[str, np.ndarray]:
    """A neo-Hookean strip of 60 kPa; 6 kV takes some kilopascals off its stress."""
    stress = 60e3 * (STRETCH - STRETCH**-2) * (1.0 - 0.1 * volts / 6e3)
    noise = 20.0 * np.random.default_rng(int(volts)).standard_normal(TIME.size)
    columns = {"time [s]": TIME, "stretch [1]": STRETCH, "nominal_stress [Pa]": stress + noise}
    return columns | ({"voltage [kV]": np.full(TIME.size, volts / 1e3)} if column else {})


def pulls(path: Path, column: bool, stated: bool, **settings: object):
    rows = [
        row(f"pull_{volts}kV", "load_unload", "stretch", "nominal_stress",
            **({"voltage_kV": volts} if stated else {}))
        for volts in (0, 6)
    ]  # fmt: skip
    records = {f"pull_{volts}kV": pull(1e3 * volts, column) for volts in (0, 6)}
    return made(path, "tensile_strip", STRIP, rows, records, ["neo_hookean"], **settings)


@pytest.mark.parametrize(("column", "stated"), [(True, True), (True, False), (False, True)])
def test_strips_pulled_under_several_voltages_are_refused(
    tmp_path: Path, column: bool, stated: bool
) -> None:
    faults = pulls(tmp_path, column, stated).faults
    assert len(faults) == column + stated
    assert all(
        "'tensile_strip'" in fault and "attributed to the material" in fault for fault in faults
    )


def test_those_of_one_voltage_are_fitted(tmp_path: Path) -> None:
    study = pulls(tmp_path, False, True, select={"voltage_kV": 0})
    assert not study.faults
    check(study.fitted("neo_hookean"), {"mu": 60e3})


def test_a_voltage_that_is_off_throughout_is_no_fault(tmp_path: Path) -> None:
    rows = [row("pull", "load_unload", "stretch", "nominal_stress", temperature_C=23)]
    study = made(tmp_path, "tensile_strip", STRIP, rows, {"pull": pull(0.0, True)}, ["neo_hookean"])
    assert not study.faults


def test_strips_of_two_temperatures_are_refused(tmp_path: Path) -> None:
    rows = [
        row(f"pull_{n}", "load_unload", "stretch", "nominal_stress", temperature_C=degrees)
        for n, degrees in enumerate((23, 60))
    ]
    records = {f"pull_{n}": pull(float(n), False) for n in range(2)}
    (fault,) = made(tmp_path, "tensile_strip", STRIP, rows, records, ["neo_hookean"]).faults
    assert "temperature_C of experiments.csv: is 23.0, 60.0 over the records" in fault
