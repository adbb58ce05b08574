"""The `deabayes` command from outside: exit statuses, messages, no tracebacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tests.workflow.command_line import ROOT, assert_one_message, deabayes


def test_a_process_of_its_own_ends_with_the_status_of_the_command() -> None:
    command = [sys.executable, "-m", "deabayes.cli.main", "fit", "tubuler", "voigt_kelvin_1"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert_one_message(run, 1, "tubuler", "'tubular'")


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

    from deabayes.cli.main import cli

    for name, command in cli.commands.items():
        result = CliRunner().invoke(cli, [name, "--help"])
        assert result.exit_code == 0
        assert (command.help or "").strip(), f"{name} has no help"
        assert "Usage:" in result.output


def test_help_loads_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "numba", "emcee")
    code = f"import sys, deabayes.cli.main; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "arguments",
    [
        ("fitt",),
        ("fit",),
        ("fit", "tubular", "voigt_kelvin_1", "--prepared", "nowhere"),
        ("check",),
    ],
)
def test_wrong_usage_ends_with_status_2(arguments: tuple[str, ...]) -> None:
    assert_one_message(deabayes(*arguments), 2, "Usage:")


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


def test_unknown_candidate_names_the_nearest() -> None:
    run = deabayes("fit", "tubular", "voigt_kelvin_9")
    assert_one_message(run, 1, "voigt_kelvin_9", "did you mean")


def test_compare_of_a_study_never_fitted(tmp_path: Path) -> None:
    run = deabayes("compare", "tubular", "--results", tmp_path)
    assert_one_message(run, 1, "tubular", "deabayes fit")


def test_export_of_a_file_or_study_that_is_not_there(tmp_path: Path) -> None:
    run = deabayes("export", "nothing.nc", "--to", "csv", "-o", "x.csv", "--results", tmp_path)
    assert_one_message(run, 1, "'nothing.nc' is neither a posterior file nor", "deabayes fit")


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
    from deabayes.cli import main as cli

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.cli, "main", interrupt)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 1
    assert "continues where" in capsys.readouterr().err


def test_a_fault_of_the_program_is_not_hidden(monkeypatch) -> None:
    from deabayes.cli import main as cli

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(cli.cli, "main", fail)
    with pytest.raises(ZeroDivisionError):
        cli.main([])
