"""A sensor that does not read zero at rest: corrected, or named with the line to write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes import simulate
from tests.cases.study_folder import check, made, noisy, row
from tests.cases.test_fast_and_slow import TUBE, displacement

STRIP = {"cross_section": (10.0, "mm^2"), "gauge_length": (50.0, "mm")}
TRUTH = {"mu": 40e3, "mu_beta_1": 30e3, "tau_1": 12.0}


def test_a_tube_that_reads_13_um_at_rest_is_zeroed_and_it_is_said(tmp_path: Path) -> None:
    time = np.arange(0.0, 0.52, 1e-3)
    voltage = np.where(time >= 0.02, 2000.0, 0.0)
    columns = {
        "time [s]": time,
        "voltage [V]": voltage,
        "displacement [m]": noisy(displacement(time, voltage, 0.05) + 13e-6, 5e-7),
    }
    rows = [row("creep", "creep", "voltage", "displacement")]
    study = made(tmp_path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])
    (said,) = [line for line in study.warnings if "at rest" in line]
    assert "at rest, where the model has 0 (" in said and "the displacement is 13" in said
    assert said.endswith("standard errors); it was subtracted (`baseline`)")


def pulled(path: Path, offset: float, rest: float, **settings: object):
    """A strip pulled to stretch 1.3 and back; its load cell reads `offset` at rest."""
    time = np.arange(0.0, 40.0, 0.1)
    displacement = 0.015 * np.clip(1.0 - np.abs(time - rest - 19.0) / 19.0, 0.0, 1.0)
    strip = {"cross_section": 1e-5, "gauge_length": 0.05}
    found = simulate(
        "tensile_strip", "neo_hookean_units_1", TRUTH, strip, time=time,
        displacement=displacement, response="force",
    )  # fmt: skip
    columns = {
        "time [s]": time,
        "displacement [m]": displacement,
        "force [N]": noisy(found["force"].values + offset, 1e-3),
    }
    rows = [row("pull", "load_unload", "displacement", "force")]
    return made(
        path, "tensile_strip", STRIP, rows, {"pull": columns}, ["neo_hookean_units_1"], **settings
    )


def test_a_load_cell_that_reads_at_rest_is_zeroed(tmp_path: Path) -> None:
    study = pulled(tmp_path, 0.02, 1.0)
    assert any("it was subtracted (`baseline`)" in line for line in study.warnings)
    check(study.fitted("neo_hookean_units_1"), TRUTH, 0.1)


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_without_a_rest_the_noise_with_an_offset_is_named(tmp_path: Path, offset: float) -> None:
    study = pulled(tmp_path, offset, 0.0)
    said = [line for line in study.warnings if "at rest" in line]
    assert bool(said) == bool(offset)
    assert all("`noise: ornstein_uhlenbeck_offset`" in line for line in said)


def test_the_noise_with_an_offset_finds_the_truth(tmp_path: Path) -> None:
    study = pulled(tmp_path, 0.02, 0.0, noise="ornstein_uhlenbeck_offset")
    check(study.fitted("neo_hookean_units_1"), TRUTH, 0.1)


def test_steps_of_ones_own_are_left_alone_and_the_line_is_named(tmp_path: Path) -> None:
    study = pulled(tmp_path, 0.02, 1.0, preparation={"load_unload": []})
    (said,) = [line for line in study.warnings if "at rest" in line]
    assert said.endswith("add `baseline: {}` to `preparation: load_unload`")


def slack(path: Path, **settings: object):
    """A strip pulled to stretch 1.6 that hangs slack for the first 1.5 %."""
    time = np.arange(0.0, 40.0, 0.05)
    stretch = 1.0 + 0.6 * np.clip(1.0 - np.abs(time - 20.0) / 20.0, 0.0, 1.0)
    taut = np.maximum(stretch / 1.015, 1.0)
    strip = {"cross_section": 1e-5, "gauge_length": 0.05}
    found = simulate(
        "tensile_strip", "neo_hookean_units_1", TRUTH, strip, time=time, stretch=taut,
        response="nominal_stress",
    )  # fmt: skip
    columns = {
        "time [s]": time,
        "stretch [1]": stretch,
        "nominal_stress [Pa]": noisy(np.maximum(found["nominal_stress"].values, 0.0), 50.0),
    }
    rows = [row("pull", "load_unload", "stretch", "nominal_stress")]
    return made(
        path, "tensile_strip", STRIP, rows, {"pull": columns}, ["neo_hookean_units_1"], **settings
    )


def test_slack_is_named_with_the_step_that_takes_it_up(tmp_path: Path) -> None:
    (said,) = [line for line in slack(tmp_path).warnings if "slack" in line]
    assert "begins to rise at a stretch of 1.01" in said
    assert "`take_up_slack: {}` first in `preparation: load_unload`" in said


def test_a_taut_strip_is_not_called_slack(tmp_path: Path) -> None:
    assert not [line for line in pulled(tmp_path, 0.0, 0.0).warnings if "slack" in line]


def test_taken_up_the_modulus_is_right(tmp_path: Path) -> None:
    steps = [
        {"take_up_slack": {}},
        {"mask_after": {"time": "34 s"}},  # slack again on the way back
        {"average": {"grid": "uniform", "points": 180}},
    ]
    study = slack(tmp_path, preparation={"load_unload": steps})
    assert not [line for line in study.warnings if "slack" in line]
    check(study.fitted("neo_hookean_units_1"), TRUTH, 0.1)


def test_a_rubber_that_stiffens_is_not_called_slack(tmp_path: Path) -> None:
    stretch = np.linspace(1.0, 9.0, 400)
    rubber = {"mu_1": 5e3, "alpha_1": 2.0, "mu_2": 0.02, "alpha_2": 8.0}
    strip = {"cross_section": 1e-5, "gauge_length": 0.05}
    found = simulate(
        "tensile_strip", "ogden_2", rubber, strip, stretch=stretch, response="nominal_stress",
        conditions={"deformation": "uniaxial"},
    )  # fmt: skip
    columns = {"stretch [1]": stretch, "nominal_stress [Pa]": found["nominal_stress"].values}
    rows = [row("pull", "quasi_static", "stretch", "nominal_stress", deformation="uniaxial")]
    study = made(tmp_path, "tensile_strip", STRIP, rows, {"pull": columns}, ["ogden_2"])
    assert not [line for line in study.warnings if "slack" in line]


def creeps(path: Path, moved: np.ndarray, noise: float = 5e-7):
    """A tube at 2 kV from 20 ms on whose sensor reads `moved`."""
    time = np.arange(0.0, 0.2, 5e-5)
    columns = {
        "time [s]": time,
        "voltage [V]": np.where(time >= 0.02, 2000.0, 0.0),
        "displacement [m]": noisy(moved, noise),
    }
    rows = [row("creep", "creep", "voltage", "displacement")]
    return made(path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])


def crept(delay: float = 0.0) -> np.ndarray:
    """Displacement [m] of a tube that begins `delay` [s] after its voltage."""
    time = np.arange(0.0, 0.2, 5e-5)
    since = np.maximum(time - 0.02 - delay, 0.0)
    at = time >= 0.02 + delay - 1e-9
    return 0.05 * np.where(at, 2.4e-3 + 1.6e-3 * -np.expm1(-since / 0.05), 0.0)


@pytest.mark.parametrize(
    ("delay", "named"),
    [(2e-4, "200 µs after the voltage, and then jumps"), (5e-5, "50 µs after the voltage"),
     (-2e-4, "200 µs before the voltage, which is impossible"), (0.0, "")],
)  # fmt: skip
def test_a_sensor_whose_clock_differs_is_named(tmp_path: Path, delay: float, named: str) -> None:
    said = [line for line in creeps(tmp_path, crept(delay)).warnings if " the voltage, " in line]
    assert len(said) == bool(named) and all(f"begins {named}" in line for line in said)


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_a_specimen_that_still_recovers_is_named(tmp_path: Path, share: float) -> None:
    time = np.arange(0.0, 0.2, 5e-5)
    study = creeps(tmp_path, crept() + share * 2e-4 * np.exp(-time / 0.02))
    said = [line for line in study.warnings if "drifts by" in line]
    assert len(said) == bool(share)
    assert all("and the model begins at rest" in line for line in said)
