"""The reference minimum-energy structure: golden tables, energy, and what ships."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from data.make import minimum_energy_structure
from data.make import minimum_energy_structure_pull as pull
from data.make.minimum_energy_structure_motion import motion
from data.make.minimum_energy_structure_truth import (
    LASER,
    LOAD_CELL,
    TRUTH,
    Truth,
    tilted,
)
from data.make.writing import write_record
from scipy.integrate import solve_ivp
from tests.shared.golden import REPOSITORY, golden_table, load_golden

from deabayes.experiment import Specimen
from deabayes.faults import Report
from deabayes.records.checks import check_record
from deabayes.records.folder import repeated_records
from deabayes.records.record import read_record
from deabayes.records.schema import violations
from deabayes.records.table import read_table
from deabayes.units import to_si

SHIPPED = REPOSITORY / "data" / "minimum_energy_structure"
PAPER = replace(TRUTH, k=TRUTH.k[:4], xi=TRUTH.xi[:4], dry_friction=0.0, amplifier_lag=0.0)
"""Without what the candidates leave out."""


def table(name):
    return np.loadtxt(SHIPPED / "records" / f"{name}.csv", delimiter=",", skiprows=1)


def test_the_shipped_descriptions_are_what_the_script_writes(tmp_path):
    minimum_energy_structure.describe(tmp_path)
    for name in ("experiments.csv", "specimen.yaml", "truth.yaml"):
        assert (tmp_path / name).read_text() == (SHIPPED / name).read_text()
    records = {path.stem: path.stat().st_size for path in (SHIPPED / "records").iterdir()}
    assert set(records) == {settings.name for settings in minimum_energy_structure.RECORDS}
    assert len(records) == 26 and sum(records.values()) < 7e6


def only_the_start(truth, command, duration):
    """`motion` for 0.3 s; what comes later stands still."""
    moved = motion(truth, command, 0.3)
    return replace(moved, states=lambda time: moved.states(np.minimum(time, 0.3)))


def test_the_shipped_records_are_what_the_script_writes(monkeypatch, tmp_path):
    """Forces and the shortest sine whole, other waves up to 0.3 s after their rest."""
    for seed, settings in enumerate(minimum_energy_structure.RECORDS):
        whole = (
            isinstance(settings, minimum_energy_structure.Pull) or settings.name == "sine_5kV_10Hz"
        )
        monkeypatch.setattr(minimum_energy_structure, "motion", motion if whole else only_the_start)
        path = tmp_path / "record.csv"
        write_record(path, settings.columns(seed))
        shipped, again = table(settings.name), np.loadtxt(path, delimiter=",", skiprows=1)
        assert shipped.shape == again.shape
        difference = shipped - again if whole else (shipped - again)[:500]
        # Another machine's last bit may turn one rounding over.
        assert np.mean(np.any(np.abs(difference) > 1e-9, axis=1)) < 0.01, settings.name
        assert np.all(np.abs(difference) < [1.1e-4, 1.1e-4, 0.011]), settings.name


def from_golden(inputs):
    """The truth with every number of a golden file's inputs."""
    return replace(
        PAPER,
        link_length=inputs["link_length_m"],
        mass_centre=inputs["mass_centre_m"],
        link_mass=inputs["link_mass_kg"],
        slider_mass=inputs["slider_mass_kg"],
        rotational_inertia=inputs["rotational_inertia_kg_m2"],
        film_thickness=inputs["film_thickness_m"],
        prestretch=inputs["prestretch"],
        window_area=inputs["window_area_m2"],
        rest_angle=np.radians(inputs["rest_angle_deg"]),
        mu=tuple(inputs["ogden_mu_Pa"]),
        alpha=tuple(inputs["ogden_alpha"]),
        relative_permittivity=inputs["relative_permittivity"],
        k=tuple(inputs["k_N_per_m"]),
        xi=tuple(inputs["xi_N_s_per_m"]),
        eta_0=inputs["eta0_N_s_per_m"],
    )


def test_forces_are_the_golden_ones():
    inputs = load_golden("mes_quasistatic")["inputs"]
    truth, golden = from_golden(inputs), golden_table("mes_quasistatic", "force")
    assert truth.hinge_stiffness == pytest.approx(inputs["hinge_stiffness_N_m_per_rad"], rel=1e-12)
    for kilovolt in (0, 2, 3, 4, 5):
        found = pull.static_force(truth, 1e3 * kilovolt, golden["displacement"])
        assert np.abs(found - golden[f"output_force_{kilovolt}kV"]).max() < 1e-10


@pytest.mark.parametrize("kilovolt", [5, 4])
@pytest.mark.parametrize("frequency", [1, 5, 10])
def test_motion_is_the_golden_one(kilovolt, frequency):
    truth = from_golden(load_golden("mes_dynamic")["inputs"])
    wave = minimum_energy_structure.Wave(1e3 * kilovolt, float(frequency), "")
    moved = motion(truth, wave.command, 10.0 / frequency)
    for period in ("first", "tenth"):
        golden = golden_table("mes_dynamic", f"{kilovolt}kV_{frequency}Hz_{period}_period")
        assert moved.amplifier(golden["time"]) == pytest.approx(golden["voltage"], abs=1e-6)
        assert np.abs(moved.displacement(golden["time"]) - golden["displacement"]).max() < 1e-8


def energy(truth: Truth, voltage, states):
    """Kinetic, elastic, electric and potential energy [J], from the paper's potentials."""
    _, angle, rate, *springs = states
    along, across = 5.0 * np.cos(angle), 1.0 / (25.0 * np.cos(angle))
    film = -0.5 * 8.8541878188e-12 * 1.704 * (voltage * np.cos(angle) / 40e-6) ** 2
    for mu, alpha in zip(truth.mu, truth.alpha, strict=True):
        film = film + mu / alpha * (along**alpha + across**alpha - along[0] ** alpha)
    weight = 2.0 * 0.603e-3 * 9.80665 * 15.78e-3 * np.sin(angle)
    hinge = 0.5 * truth.hinge_stiffness * (2.0 * angle) ** 2
    slide = 4.0 * 0.0335 * (0.603e-3 * (0.0335 - 0.01578) + 0.40e-3 * 0.0335)
    inertia = 2.0 * (156.56e-9 + 0.603e-3 * 0.01578**2) + slide * np.sin(angle) ** 2
    units = sum(0.5 * k * x**2 for k, x in zip(truth.k, springs, strict=True))
    return 0.5 * inertia * rate**2 + 1.5e-3 * 40e-6 * film + weight + hinge + units


def test_energy_is_kept_without_losses_and_only_lost_with_them():
    time = np.linspace(0.0, 0.5, 2001)
    bare = replace(PAPER, k=(), xi=(), eta_0=0.0)
    moved = motion(bare, lambda _: 2e3, 0.5)
    kept = energy(bare, 2e3, moved.states(time))
    swing = np.ptp(0.5 * 2e-6 * moved.states(time)[2] ** 2)
    assert np.ptp(moved.displacement(time)) > 3e-3
    assert np.ptp(kept) < 1e-6 * swing
    for lossy in (replace(bare, eta_0=0.01), replace(bare, dry_friction=3e-4),
                  replace(bare, k=(8.0,), xi=(4.0,))):  # fmt: skip
        left = energy(lossy, 2e3, motion(lossy, lambda _: 2e3, 0.5).states(time))
        assert np.diff(left).max() < 1e-6 * swing
        assert left[0] - left[-1] > 0.01 * swing


def test_at_rest_without_voltage_it_stays():
    moved = motion(TRUTH, lambda _: 0.0, 1.0)
    assert np.abs(moved.displacement(np.linspace(-0.1, 1.0, 50))).max() < 1e-12


def test_the_amplifier_lags():
    wave, lag = minimum_energy_structure.Wave(5e3, 10.0, ""), TRUTH.amplifier_lag
    time = np.linspace(-0.01, 0.3, 700)
    turn = 2.0 * np.pi * 10.0
    followed = (np.cos(turn * time) + turn * lag * np.sin(turn * time)) / (1 + (turn * lag) ** 2)
    start = 2750.0 - 2250.0 / (1 + (turn * lag) ** 2)
    exact = 2750.0 - 2250.0 * followed - start * np.exp(-time / lag)
    found = motion(TRUTH, wave.command, 0.3).amplifier(time)
    assert found == pytest.approx(np.where(time < 0.0, 0.0, exact), abs=1e-3)


def test_the_sweep_passes_all_frequencies():
    sweep = minimum_energy_structure.RECORDS[-1]
    assert sweep.name == "sweep_5kV"
    time = np.linspace(39.9, 40.0, 20_001)
    volts = np.array([sweep.command(t) for t in time])
    tops = time[1:-1][(volts[1:-1] > volts[:-2]) & (volts[1:-1] >= volts[2:])]
    between = 60.0 ** (0.5 * (tops[-1] + tops[-2]) / 40.0)
    assert 1.0 / (tops[-1] - tops[-2]) == pytest.approx(between, rel=1e-3)
    assert volts.max() == pytest.approx(5000.0, abs=0.01)
    assert sweep.command(0.0) == pytest.approx(500.0)
    first = 40.0 / np.log(60.0) * np.log1p(np.log(60.0) / 40.0)  # where one cycle is over
    assert sweep.command(first) == pytest.approx(500.0)


def test_the_pulled_units_agree_with_an_integration():
    tau, times = 62.5, np.array([10.0, 300.0, 710.0, 900.0, 1400.0])
    jog = pull.LOWEST / pull.SPEED

    def slope(t, y):
        inward = t < 0.0 or t > pull.TRAVEL
        return [(-1.0 if inward else 1.0) * pull.SPEED - y[0] / tau]

    found = pull._extension(tau, times)
    exact = solve_ivp(slope, (jog, 1400.0), [0.0], "RK45", times, rtol=1e-8, atol=1e-12).y[0]
    assert found == pytest.approx(exact, rel=1e-4)


def test_hysteresis_of_the_forces_is_small_and_largely_averaged_out():
    time = np.linspace(0.0, 2.0 * pull.TRAVEL, 113)
    for kilovolt in (0, 5):
        force = pull.force(TRUTH, 1e3 * kilovolt, time)
        out, back = force[:57], force[:55:-1]
        mean = 0.5 * (out + back)
        relaxed = pull.static_force(TRUTH, 1e3 * kilovolt, pull.positions())
        assert 0.03 < np.max(back - out) / np.ptp(mean) < 0.06
        assert np.abs(mean - relaxed).max() < 0.0075
        read = 1e-3 * table(f"quasi_static_{kilovolt}kV")[:, 2]
        error = read - mean
        assert np.std(error) < 1.5 * LOAD_CELL.sigma_white and np.abs(error.mean()) < 8e-4
        # White noise of two readings averaged, in a difference of two such; the rest is slow.
        assert np.std(np.diff(error)) == pytest.approx(LOAD_CELL.sigma_white, rel=0.3)


def test_what_the_candidates_leave_out_shows_and_does_not_dominate():
    wave, time = minimum_energy_structure.Wave(5e3, 1.0, ""), np.linspace(0.0, 4.0, 801)
    whole = motion(TRUTH, wave.command, 4.0).displacement(time)
    lacking = {
        "slow unit": replace(TRUTH, k=TRUTH.k[:4], xi=TRUTH.xi[:4]),
        "dry friction": replace(TRUTH, dry_friction=0.0),
        "lag": replace(TRUTH, amplifier_lag=0.0),
    }
    for name, truth in lacking.items():
        apart = np.abs(whole - motion(truth, wave.command, 4.0).displacement(time)).max()
        assert LASER.sigma_white < apart < 0.06 * np.ptp(whole), name


def test_the_laser_reads_late_and_tilted():
    time, _, millimetre = table("sine_5kV_10Hz").T
    since = time - 0.2
    moved = motion(TRUTH, minimum_energy_structure.Wave(5e3, 10.0, "").command, float(since[-1]))
    late = moved.displacement(since - 5e-4)
    read = 1e-3 * (millimetre - np.mean(millimetre[:190]))
    assert np.std(read - tilted(late)) < 8e-6 < np.std(read - tilted(moved.displacement(since)))
    grown = np.polyfit((late / 12.35e-3) ** 2, read - late, 1)[0]
    assert grown == pytest.approx(0.0012 * 0.1, rel=0.15)


def test_the_loop_drifts_and_settles():
    """The transition region of the paper: upwards over seconds, then one stable loop."""
    time, kilovolt, millimetre = table("sine_5kV_1Hz").T
    period = np.floor(time - 0.2).astype(int)
    mean = np.array([millimetre[period == n].mean() for n in range(50)])
    assert mean[10] - mean[0] > 0.8 and 0.0 < mean[49] - mean[40] < 0.1
    assert np.all(np.abs(kilovolt[time > 0.21] - 2.75) < 2.252)
    assert np.ptp(table("sine_5kV_1Hz")[-1000:, 2]) > 1.5 * np.ptp(table("sine_5kV_10Hz")[-100:, 2])


def test_records_are_read_and_have_no_faults():
    rows = read_table(SHIPPED)
    raws = {row.name: read_record(SHIPPED / row.record) for row in rows}
    anything = Specimen("x", "", {}, {}, {})
    for row in rows:
        report = check_record(row, raws[row.name], anything, row.name)
        assert report.faults == report.warnings == []
    repeated_records([(row, raws[row.name]) for row in rows], report := Report())
    assert report.faults == []
    calibrate = {row.name for row in rows if row.role == "calibrate"}
    sines = {f"sine_5kV_{frequency}Hz" for frequency in (1, 5, 10)}
    assert calibrate == {"quasi_static_0kV", "quasi_static_5kV", *sines}
    assert raws["quasi_static_4kV"].columns["force"].max() == pytest.approx(0.12, abs=0.01)


def test_what_the_specimen_states_is_near_the_truth():
    specimen = yaml.safe_load((SHIPPED / "specimen.yaml").read_text())
    assert violations(specimen, "specimen", "specimen.yaml") == []
    assert specimen["provenance"]["kind"] == "simulated"
    assert "fifth, slow Maxwell unit" in specimen["provenance"]["source"]
    true = yaml.safe_load((SHIPPED / "truth.yaml").read_text())["specimen"]
    uncertain = set()
    for name, stated in specimen["quantities"].items():
        value = to_si(stated["value"], stated["unit"])
        if "sd" in stated:
            uncertain.add(name)
            assert abs(value - true[name]) < to_si(stated["sd"], stated["unit"]), name
        else:
            assert value == pytest.approx(true[name], rel=1e-12), name
    assert uncertain == {"window_area", "rest_angle", "hinge_stiffness"}
    assert "relative_permittivity" not in specimen["quantities"]
