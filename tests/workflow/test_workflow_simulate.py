"""`deabayes simulate` from outside: responses written, and what is said where there are none."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.workflow.command_line import assert_one_message, deabayes


def test_simulate_follows_the_excitation(tmp_path: Path) -> None:
    drive = tmp_path / "drive.csv"
    drive.write_text("time [ms],voltage [kV]\n0,1\n100,1\n200,1\n")
    output = tmp_path / "response.csv"
    run = deabayes(
        *("simulate", "tubular", "voigt_kelvin_1", "--specimen", "data/tubular"),
        *("--excitation", drive, "--set", "E_0=1.5e6", "--set", "E_1=6e6", "--set", "tau_1=0.1"),
        *("-o", output),
    )
    assert run.returncode == 0, run.stderr
    header, *rows = output.read_text().splitlines()
    assert header.startswith("time [s],strain [1],voltage [V],E_0 [Pa],")
    assert len(rows) == 3
    again = deabayes(
        *("simulate", "tubular", "voigt_kelvin_1", "--specimen", "data/tubular"),
        *("--excitation", output, "--set", "E_0=1.5 MPa", "--set", "E_1=6e6"),
        *("--set", "tau_1=100 ms", "-o", tmp_path / "again.csv"),
    )
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again.csv").read_text() == output.read_text()


def test_simulate_under_a_load(tmp_path: Path) -> None:
    drive = tmp_path / "drive.csv"
    drive.write_text("time [ms],voltage [kV]\n0,1\n10,1\n20,1\n")
    found = []
    for load in ("0", "300", "heavy"):
        run = deabayes(
            *("simulate", "tubular", "voigt_kelvin_1_inertia", "--specimen", "data/tubular"),
            *("--excitation", drive, "--set", "E_0=1.5 MPa", "--set", "E_1=6 MPa"),
            *("--set", "tau_1=100 ms", "--set", "moving_mass=83 g"),
            *("--condition", f"load_g={load}", "-o", tmp_path / "response.csv"),
        )
        found.append((tmp_path / "response.csv").read_text())
    assert found[0] != found[1]
    assert_one_message(run, 1, "load_g", "heavy")


def test_simulate_says_why_a_response_is_missing(tmp_path: Path) -> None:
    drive, response = tmp_path / "drive.csv", tmp_path / "response.csv"
    drive.write_text("time [s],voltage [kV]\n0,0\n1,0\n1.01,8\n5,8\n")
    material = {"mu_alpha": 35e3, "zeta_alpha": 1e3, "J_alpha": 400, "J_beta": 400}
    unit = {"mu_beta_1": 2e4, "tau_beta_1": 100}
    run = deabayes(
        *("simulate", "membrane", "kv_gm_1", "--specimen", "data/membrane"),
        *("--excitation", drive, "-o", response),
        *(
            word
            for name, value in {**material, **unit}.items()
            for word in ("--set", f"{name}={value}")
        ),
    )
    assert run.returncode == 0, run.stderr
    header, *rows = (line.split(",") for line in response.read_text().splitlines())
    assert {row[header.index("stretch [1]")] for row in rows} == {""}
    assert f"{response}: cells without a response are empty: pull-in; at 1.0" in run.stderr
    assert "under 8 kV" in run.stderr


def simulate_from(record: Path, *more: str | Path) -> subprocess.CompletedProcess[str]:
    return deabayes(
        *("simulate", "tubular", "voigt_kelvin_1", "--specimen", "data/tubular"),
        *("--excitation", record, "--set", "E_0=1.5e6", "--set", "E_1=6e6", "--set", "tau_1=0.1"),
        *more,
    )


def test_simulate_takes_the_drive_of_a_whole_record(tmp_path: Path) -> None:
    record = tmp_path / "record.csv"
    record.write_text("time [ms],displacement [mm],current [mA],voltage [kV]\n0,0,3,1\n100,1,0,1\n")
    alone = tmp_path / "alone.csv"
    alone.write_text("time [ms],voltage [kV]\n0,1\n100,1\n")
    for drive in (record, alone):
        run = simulate_from(drive, "-o", drive.with_suffix(".out"))
        assert run.returncode == 0, run.stderr
    assert record.with_suffix(".out").read_text() == alone.with_suffix(".out").read_text()


def test_simulate_from_a_record_without_a_drive(tmp_path: Path) -> None:
    record = tmp_path / "record.csv"
    record.write_text("time [ms],displacement [mm]\n0,0\n100,1\n")
    run = simulate_from(record, "-o", tmp_path / "response.csv")
    assert_one_message(run, 1, "record.csv", "driven by voltage", "time, displacement")


def test_a_parameter_that_is_no_number(tmp_path: Path) -> None:
    drive = tmp_path / "drive.csv"
    drive.write_text("time [ms],voltage [kV]\n0,1\n100,1\n")
    run = deabayes(
        *("simulate", "tubular", "voigt_kelvin_1", "--specimen", "data/tubular"),
        *("--excitation", drive, "--set", "E_0=soft", "--set", "E_1=6e6", "--set", "tau_1=0.1"),
        *("-o", tmp_path / "response.csv"),
    )
    assert_one_message(run, 1, "E_0", "expected a number and a unit", "'soft'")
