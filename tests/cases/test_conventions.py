"""Signs, units, metadata and holds as laboratories have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes import simulate
from deabayes.faults import UserError
from deabayes.systems.springs.base import principal_stretches
from deabayes.units import parse_quantity, to_si
from tests.cases.study_folder import check, made, noisy, row
from tests.cases.test_fast_and_slow import TUBE

STRIP = {"cross_section": (10.0, "mm^2"), "gauge_length": (50.0, "mm")}
VALUES = {"cross_section": 1e-5, "gauge_length": 0.05}
TRUTH = {"mu": 40e3, "mu_beta_1": 30e3, "tau_1": 12.0}


def relaxation(path: Path, first: float, noise: float):
    """A ramp of 2 s to stretch 2 and its hold, from the time `first` on."""
    time = np.arange(0.0, 60.0, 0.05)
    stretch = 1.0 + np.minimum(time / 2.0, 1.0)
    found = simulate(
        "tensile_strip", "neo_hookean_units_1", TRUTH, VALUES, time=time, stretch=stretch,
        response="nominal_stress",
    )  # fmt: skip
    kept = time >= first
    columns = {
        "time [s]": time[kept],
        "stretch [1]": noisy(stretch, noise)[kept],
        "nominal_stress [Pa]": noisy(found["nominal_stress"].values, 50.0, 2)[kept],
    }
    rows = [row("hold", "relaxation", "stretch", "nominal_stress")]
    return made(path, "tensile_strip", STRIP, rows, {"hold": columns}, ["neo_hookean_units_1"])


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_hold_without_its_ramp_is_refused(tmp_path: Path, noise: float) -> None:
    (fault,) = relaxation(tmp_path, 2.0, noise).faults
    assert "is constant or hardly changes; a relaxation needs the ramp that led to it" in fault


def test_a_relaxation_with_its_ramp_is_no_fault(tmp_path: Path) -> None:
    assert not relaxation(tmp_path, 0.0, 0.0).faults


def pressed(path: Path, unit: str, force_unit: str):
    """A cylinder pressed by 30 %; the machine counts position and load downwards."""
    stretch = 1.0 - 0.3 * np.linspace(0.0, 1.0, 200)
    stress = 100e3 * (stretch - stretch**-2)
    columns = {
        f"displacement [{unit}]": 50.0 * (1.0 - stretch),
        f"force [{force_unit}]": noisy(-1e-5 * stress, 2e-4),
    }
    rows = [row("press", "quasi_static", "displacement", "force")]
    return made(path, "tensile_strip", STRIP, rows, {"press": columns}, ["ogden_1"])


def test_pressing_is_turned_by_a_minus_before_the_unit(tmp_path: Path) -> None:
    study = pressed(tmp_path, "-mm", "-N")
    assert not study.faults
    posterior = study.fitted("ogden_1")
    check(posterior, {"mu_0": 100e3, "alpha_1": 2.0}, 0.1)


def test_a_factor_before_a_unit_counts() -> None:
    np.testing.assert_allclose(to_si([1.0, 3.0], "2 kV"), [2000.0, 6000.0])
    assert to_si(4.0, "0.5 mm") == pytest.approx(2e-3)
    assert to_si(4.0, "-mm") == pytest.approx(-4e-3)
    assert to_si(4.0, "1/V") == 4.0 and to_si(4.0, "-") == 4.0
    with pytest.raises(UserError, match="two numbers"):
        parse_quantity("3 5 kPa", "Pa", "x")


@pytest.mark.parametrize(
    ("unit", "pascal"), [("N/m2", 1.0), ("N/mm2", 1e6), ("kgf/cm2", 98066.5), ("kN/m2", 1e3)]
)
def test_a_power_without_its_sign_is_a_power(unit: str, pascal: float) -> None:
    assert to_si(1.0, unit, "Pa") == pytest.approx(pascal)


@pytest.mark.parametrize("unit", ["kgs", "Nm/s2x", "kPaa"])
def test_no_other_unit_is_suggested(unit: str) -> None:
    with pytest.raises(UserError) as caught:
        to_si(1.0, unit)
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("simple_shear", "known: uniaxial, equibiaxial, pure_shear (simple shear is none)"),
        ("shear", "known: uniaxial, equibiaxial, pure_shear (simple shear is none)"),
        ("biaxial", "did you mean 'equibiaxial'?"),
    ],
)
def test_no_other_deformation_is_suggested(name: str, said: str) -> None:
    with pytest.raises(UserError) as caught:
        principal_stretches(np.ones(3), name)
    assert str(caught.value).endswith(said)


def sine(path: Path, interval: float, factor: float, **stated: object):
    """Two seconds of a tube at 10 Hz, its time off by a factor."""
    time = np.arange(0.0, 2.0, interval)
    voltage = 1000.0 * (1.0 - np.cos(20.0 * np.pi * time))
    columns = {
        "time [s]": factor * time,
        "voltage [V]": voltage,
        "displacement [m]": noisy(1e-5 * (voltage / 1e3) ** 2, 1e-7),
    }
    rows = [row("sine", "sine", "voltage", "displacement", **stated)]
    return made(path, "tubular", TUBE, rows, {"sine": columns}, ["voigt_kelvin_1"])


@pytest.mark.parametrize(
    ("interval", "factor", "stated", "said"),
    [
        (1e-3, 1e3, {"frequency_Hz": 10}, "frequency_Hz of experiments.csv is 10"),  # ms for s
        (1e-3, 1.0, {"frequency_Hz": 5}, "but the record has 10 Hz"),
        (0.055, 1.0, {"frequency_Hz": 10}, "fewer than 4 a period"),
        (1e-3, 1.0, {"amplitude_kV": 2.0}, "amplitude_kV of experiments.csv is 2"),
        (1e-3, 1.0, {"duration_s": 20}, "duration_s of experiments.csv is 20"),
    ],
)
def test_what_the_record_contradicts_is_a_fault(
    tmp_path: Path, interval: float, factor: float, stated: dict, said: str
) -> None:
    assert any(said in fault for fault in sine(tmp_path, interval, factor, **stated).faults)


def test_what_the_record_bears_out_is_none(tmp_path: Path) -> None:
    stated = {"frequency_Hz": 10, "amplitude_kV": 1.0, "duration_s": 2.0}
    assert not sine(tmp_path, 1e-3, 1.0, **stated).faults


def test_every_ramp_of_a_staircase_has_its_end_masked() -> None:
    from tests.shared.strip_records import prepared, raw

    time = np.arange(0.0, 40.0, 0.01)
    displacement = 0.02 * np.minimum(time % 10.0, 1.0) + 0.02 * (time // 10.0)
    record = raw(time, displacement, 1.0 + displacement)
    hidden = prepared(record, {"mask_ramp_end": {"before": "0.1 s", "after": "0.3 s"}})
    gaps = hidden.coordinate[:-1][np.diff(hidden.coordinate) > 0.1]
    np.testing.assert_allclose(gaps, [0.9, 10.9, 20.9, 30.9], atol=0.02)
