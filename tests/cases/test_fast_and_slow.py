"""Records much faster or slower than the papers': times, moduli and bins follow them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deabayes import simulate
from tests.cases.study_folder import check, made, noisy, row

TUBE = {
    "thickness": (80.0, "um"),
    "relative_permittivity": (3.1, "1"),
    "active_length": (50.0, "mm"),
}
FILM = {"thickness": (100.0, "um"), "permittivity": (25.0, "pF/m"), "prestretch": (1.3, "1"),
        "side_length": (40.0, "mm")}  # fmt: skip
PRESSURE = 3.1 * 8.8541878128e-12 * (2000.0 / 80e-6) ** 2


def displacement(time: np.ndarray, voltage: np.ndarray, tau: float) -> np.ndarray:
    """Of the tube; its voltage is linear between samples."""
    truth = {"E_0": PRESSURE / 2.4e-3, "E_1": PRESSURE / 1.6e-3, "tau_1": tau}
    tube = {"thickness": 80e-6, "relative_permittivity": 3.1, "active_length": 0.05}
    found = simulate(
        "tubular", "voigt_kelvin_1", truth, tube, time=time, voltage=voltage,
        response="displacement",
    )  # fmt: skip
    return found["displacement"].values


def creep(path: Path, tau: float, start: float, end: float, interval: float, noise: float):
    """A tube's creep at 2 kV: 2.4e-3 at once and 1.6e-3 more with the time constant tau."""
    time = np.arange(0.0, end, interval)
    voltage = np.where(time >= start, 2000.0, 0.0)
    columns = {
        "time [s]": time,
        "voltage [V]": voltage,
        "displacement [m]": noisy(displacement(time, voltage, tau), noise),
    }
    rows = [row("creep", "creep", "voltage", "displacement")]
    return made(path, "tubular", TUBE, rows, {"creep": columns}, ["voigt_kelvin_1"])


@pytest.mark.parametrize(
    ("tau", "start", "end", "interval", "noise"),
    [
        (4e-3, 0.02, 0.52, 1e-3, 1e-7),  # as long as the first bin
        (50.0, 2.0, 1802.0, 1.0, 5e-7),
    ],
)
def test_a_tube_creeps_in_milliseconds_or_minutes(
    tmp_path: Path, tau: float, start: float, end: float, interval: float, noise: float
) -> None:
    study = creep(tmp_path, tau, start, end, interval, noise)
    assert not study.faults
    truth = {"E_0": PRESSURE / 2.4e-3, "E_1": PRESSURE / 1.6e-3, "tau_1": tau}
    posterior = study.fitted("voigt_kelvin_1")
    check(posterior, truth)
    assert posterior.leaning == ()


def test_a_stiff_membrane_relaxes_in_milliseconds(tmp_path: Path) -> None:
    truth = {"mu_alpha": 300e3, "zeta_alpha": 100.0, "J_alpha": 100.0, "mu_beta_1": 150e3,
             "tau_beta_1": 0.2, "J_beta": 100.0}  # fmt: skip
    time = np.arange(0.0, 1.0, 2e-3)
    voltage = np.where(time >= 0.05, 3500.0, 0.0)
    film = {"thickness": 1e-4, "permittivity": 25e-12, "prestretch": 1.3, "side_length": 0.04}
    found = simulate(
        "membrane", "kv_gm_1", truth, film, time=time, voltage=voltage, response="stretch"
    )
    stretch = noisy(found["stretch"].values, 5e-5)
    columns = {"time [s]": time, "voltage [V]": voltage, "stretch [1]": stretch}
    rows = [row("step", "step", "voltage", "stretch")]
    study = made(tmp_path, "membrane", FILM, rows, {"step": columns}, ["kv_gm_1"])
    assert not study.faults
    posterior = study.fitted("kv_gm_1")
    check(posterior, {name: truth[name] for name in ("zeta_alpha", "mu_beta_1", "tau_beta_1")})
    assert posterior.leaning == ()


def test_a_bound_that_decides_is_named_with_the_line_to_write(tmp_path: Path) -> None:
    study = creep(tmp_path, 10.0, 2.0, 62.0, 0.05, 5e-7)
    priors = {"tau": {"distribution": "loguniform", "lower": "1 ms", "upper": "2 s"}}
    object.__setattr__(study.study, "priors", priors)
    (said,) = study.fitted("voigt_kelvin_1").leaning
    assert said.startswith("tau_1: ") and "upper bound of its prior, 2 s" in said
    assert "`priors: {tau: {distribution: loguniform, lower: 0.001 s, upper: 20 s}}`" in said
