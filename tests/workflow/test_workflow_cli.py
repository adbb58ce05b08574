"""The `deabayes` command from outside: exit statuses, messages, no tracebacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def deabayes(*arguments: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "deabayes.cli", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "DEABAYES_DATA": ""},
        check=False,
    )


def assert_one_message(run: subprocess.CompletedProcess[str], status: int, *words: str) -> None:
    assert run.returncode == status, run.stderr
    assert "Traceback" not in run.stderr
    assert run.stdout == ""
    for word in words:
        assert word in run.stderr


def test_version_and_help() -> None:
    from importlib.metadata import version

    assert version("deabayes") in deabayes("--version").stdout
    overview = deabayes("--help")
    assert overview.returncode == 0
    for command in (
        "new",
        "check",
        "fit",
        "compare",
        "nested",
        "further",
        "predict",
        "analyse",
        "report",
        "simulate",
        "export",
    ):
        assert f"  {command} " in overview.stdout


def test_every_command_explains_itself() -> None:
    from click.testing import CliRunner

    from deabayes.cli import cli

    for name, command in cli.commands.items():
        result = CliRunner().invoke(cli, [name, "--help"])
        assert result.exit_code == 0
        assert (command.help or "").strip(), f"{name} has no help"
        assert "Usage:" in result.output


def test_help_loads_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "numba", "emcee")
    code = f"import sys, deabayes.cli; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "arguments",
    [
        ("fitt",),
        ("fit",),
        ("fit", "tubular", "voigt_kelvin_1", "--ensemble", "0"),
        ("fit", "tubular", "voigt_kelvin_1", "--ensemble", "1"),
        ("export", "no_such_file.nc", "--to", "csv", "-o", "x.csv"),
        ("check",),
    ],
)
def test_wrong_usage_ends_with_status_2(arguments: tuple[str, ...]) -> None:
    assert_one_message(deabayes(*arguments), 2, "Usage:")


def test_unknown_study_names_the_nearest() -> None:
    assert_one_message(deabayes("fit", "tubuler", "voigt_kelvin_1"), 1, "tubuler", "'tubular'")


def test_check_of_a_folder_that_is_not_there() -> None:
    run = deabayes("check", "data/nothing")
    assert run.returncode == 1
    assert "data/nothing: there is no such folder" in run.stderr
    assert "Traceback" not in run.stderr


def test_check_says_what_was_understood() -> None:
    run = deabayes("check", "data/tubular")
    assert run.returncode == 0, run.stderr
    assert "creep_2000V: creep, calibrate, voltage -> displacement" in run.stdout
    assert "0 faults" in run.stdout


def test_commands_without_a_configuration(tmp_path: Path) -> None:
    run = deabayes("fit", "tubular", "voigt_kelvin_1", cwd=tmp_path)
    assert_one_message(run, 1, "config.yaml")


def test_new_study_is_reported_as_unfinished(tmp_path: Path) -> None:
    made = deabayes("new", "mine", "--system", "tensile_strip", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "mine:" in made.stdout
    checked = deabayes("check", "data/mine", cwd=tmp_path)
    assert checked.returncode == 1
    assert "Traceback" not in checked.stderr


@pytest.mark.parametrize(
    ("asked", "words"),
    [("[a", ("--asked", "is no YAML")), ("{a: {excitation: 2}}", ("'like' is missing",)),
     ("[a]", ("further_experiments",))],
)  # fmt: skip
def test_experiments_asked_for_wrongly(tmp_path: Path, asked: str, words: tuple[str, ...]) -> None:
    assert_one_message(deabayes("further", tmp_path, "--asked", asked), 1, *words)


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
    assert f"{response}: cells are empty: pull-in; at 1.0" in run.stderr
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
    assert_one_message(run, 1, "record.csv", "no column voltage", "time, displacement")


def test_a_parameter_that_is_no_number(tmp_path: Path) -> None:
    drive = tmp_path / "drive.csv"
    drive.write_text("time [ms],voltage [kV]\n0,1\n100,1\n")
    run = deabayes(
        *("simulate", "tubular", "voigt_kelvin_1", "--specimen", "data/tubular"),
        *("--excitation", drive, "--set", "E_0=soft", "-o", tmp_path / "response.csv"),
    )
    assert_one_message(run, 1, "E_0=soft", "SI")


def test_unknown_candidate_names_the_nearest() -> None:
    run = deabayes("fit", "tubular", "voigt_kelvin_9")
    assert_one_message(run, 1, "voigt_kelvin_9", "did you mean")


def test_compare_of_a_study_never_fitted(tmp_path: Path) -> None:
    run = deabayes("compare", "tubular", "--results", tmp_path)
    assert_one_message(run, 1, "tubular", "deabayes fit")


def test_a_file_that_is_no_posterior(tmp_path: Path) -> None:
    wrong = tmp_path / "posterior.nc"
    wrong.write_text("not netCDF")
    run = deabayes("export", wrong, "--to", "csv", "-o", tmp_path / "draws.csv")
    assert_one_message(run, 1, str(wrong))
    assert not (tmp_path / "draws.csv").exists()


def test_a_broken_configuration_is_one_message(tmp_path: Path) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("studies: {tubular: {specimen: data/tubular, candidtaes: [voigt_kelvin_1]}}")
    run = deabayes("fit", "tubular", "voigt_kelvin_1", "--config", config)
    assert_one_message(run, 1, "candidtaes", "candidates", str(config))


def test_an_interrupt_ends_without_a_traceback(monkeypatch, capsys) -> None:
    from deabayes import cli

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.cli, "main", interrupt)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 1
    assert "goes on where" in capsys.readouterr().err


def test_a_fault_of_the_program_is_not_hidden(monkeypatch) -> None:
    from deabayes import cli

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(cli.cli, "main", fail)
    with pytest.raises(ZeroDivisionError):
        cli.main([])
