"""A user's mistakes on the command line: one clear sentence each, and exit status 1."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from deabayes.cli.main import main
from deabayes.records.preparation.prepared import read_overview, read_prepared

ROOT = Path(__file__).resolve().parents[2]
CONFIG = """\
studies:
  tubular:
    specimen: data/tubular
    candidates: [voigt_kelvin_1, voigt_kelvin_2]
    calibrate: [creep_2000V]
    validate: [creep_2500V, creep_1500V]
    priors: {}
"""
RECORD = Path("data/tubular/records/creep_1500V.csv")
TABLE = Path("data/tubular/experiments.csv")
SPECIMEN = Path("data/tubular/specimen.yaml")
PRIOR = "distribution: lognormal, median: 1 MPa, sigma: 0.5"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a configuration and the shipped creep records."""
    shutil.copytree(ROOT / "data" / "tubular", tmp_path / "data" / "tubular")
    (tmp_path / "config.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def replace(path: str | Path, old: str, new: str) -> Callable[[], None]:
    """A mistake: the first `old` in a file becomes `new`."""

    def make() -> None:
        text = Path(path).read_text(encoding="utf-8")
        assert old in text, f"{path} holds no {old!r}"
        Path(path).write_text(text.replace(old, new, 1), encoding="utf-8")

    return make


def prior(text: str) -> Callable[[], None]:
    return replace("config.yaml", "priors: {}", f"priors: {{{text}}}")


MISTAKES: dict[str, tuple[Callable[[], object], list[str]]] = {
    "missing file": (lambda: RECORD.unlink(), ["creep_1500V.csv", "no such file", "put it there"]),
    "typo in protocol": (
        replace(TABLE, "creep_1500V,creep", "creep_1500V,crep"),
        ["experiments.csv, line 4, protocol", "'crep'", "did you mean 'creep'?"],
    ),
    "wrong unit": (
        replace(RECORD, "[kV]", "[kN]"),
        ["creep_1500V.csv, column voltage", "'kN' is a force", "expected a voltage"],
    ),
    "unknown unit": (replace(RECORD, "[kV]", "[kVolts]"), ["column voltage", "'kVolts'"]),
    "NaN in record": (
        replace(RECORD, "\n0.0002,", "\n0.0002,nan,0\n0.00025,"),
        ["creep_1500V.csv", "column voltage", "NaN", "data row 3"],
    ),
    "quantity not positive": (
        replace(SPECIMEN, "thickness:\n    value: ", "thickness:\n    value: -"),
        ["quantities.thickness", "must be positive"],
    ),
    "unknown candidate": (
        replace("config.yaml", "voigt_kelvin_2", "voigt_klvin_2"),
        ["study tubular, candidates", "'voigt_klvin_2'", "voigt_kelvin_K"],
    ),
    "prior of unknown law": (
        prior(f"E_0: {{{PRIOR.replace('lognormal', 'lognrmal')}}}"),
        ["study tubular, priors.E_0", "'lognrmal'", "did you mean 'lognormal'?"],
    ),
    "prior without a setting": (
        prior("E_0: {distribution: lognormal, median: 1 MPa}"),
        ["study tubular, priors.E_0", "add sigma"],
    ),
    "prior in another unit": (
        prior(f"E_0: {{{PRIOR.replace('MPa', 'mm')}}}"),
        ["study tubular, priors.E_0.median", "'mm' is a length"],
    ),
    "prior of no parameter": (
        prior(f"E_00: {{{PRIOR}}}"),
        ["study tubular, priors.E_00", "did you mean 'E_0'?"],
    ),
    "prior that is no mapping": (prior("E_0: 3"), ["config.yaml", "priors.E_0", "found 3"]),
    "bad YAML": (
        replace("config.yaml", "[voigt_kelvin_1, voigt_kelvin_2]", "[voigt_kelvin_1"),
        ["config.yaml, line 5", "correct the YAML"],
    ),
    "unknown key": (
        replace("config.yaml", "priors:", "prior:"),
        ["config.yaml, studies.tubular", "'prior'", "did you mean 'priors'?"],
    ),
    "unknown step": (
        replace("config.yaml", "priors: {}", "preparation: {creep: [mask_befor: {time: 1 s}]}"),
        ["preparation.creep", "'mask_befor'", "did you mean 'mask_before'?"],
    ),
    "unknown setting of a step": (
        replace("config.yaml", "priors: {}", "preparation: {creep: [mask_before: {tim: 1 s}]}"),
        ["mask_before", "'tim'", "did you mean 'time'?"],
    ),
    "unknown noise": (
        replace("config.yaml", "priors: {}", "noise: whit"),
        ["study tubular, noise", "did you mean 'white'?"],
    ),
}


def message(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command says on standard error; it must end with status 1."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 1
    return capsys.readouterr().err


@pytest.mark.parametrize("command", ["check", "prepare"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence(
    place: Path, capsys: pytest.CaptureFixture[str], mistake: str, command: str
) -> None:
    make, words = MISTAKES[mistake]
    make()
    output = ("-o", "prepared") if command == "prepare" else ()
    said = message(capsys, command, "tubular", *output)
    assert said.count("\n") == 1, said
    assert said.startswith("deabayes: ")
    for word in words:
        assert word in said
    assert not (place / "prepared").exists()


@pytest.mark.parametrize(
    "arguments",
    [("check",), ("prepare", "-o", "x"), ("fit", "voigt_kelvin_1"), ("data",)],
    ids=lambda arguments: arguments[0],
)
def test_an_unknown_study(
    place: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    said = message(capsys, arguments[0], "tubulr", *arguments[1:])
    assert said == "deabayes: config.yaml: has no study 'tubulr'; did you mean 'tubular'?\n"


def test_a_report_of_a_study_that_is_none(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = message(capsys, "report", "tubulr")
    assert "'tubulr' is neither a results folder nor a fitted study under results" in said
    assert not (place / "results").exists()


def test_figures_of_what_is_not_fitted_leave_no_folder(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "holds no fitted candidate" in message(capsys, "figures", "data", "-o", "drawn")
    assert not (place / "drawn").exists()


def test_a_damaged_result_is_named(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = place / "results" / "s" / "voigt_kelvin_1"
    folder.mkdir(parents=True)
    (folder / "posterior.nc").write_bytes(b"half a file")
    said = message(capsys, "report", "s")
    assert "posterior.nc: not a readable netCDF file" in said
    assert not (place / "results" / "report" / "index.html").exists()


def test_a_control_voltage_is_prepared_as_the_voltage_it_asks_for(place: Path) -> None:
    replace(RECORD, "voltage [kV]", "control_voltage [kV]")()
    replace(TABLE, "creep_1500V.csv,validate,voltage", "creep_1500V.csv,validate,control_voltage")()
    main(["prepare", "tubular", "-o", "prepared"])
    path = place / "prepared" / "creep_1500V.nc"
    assert read_prepared(path).excitation.name == "voltage"
    assert read_overview(path).excitation.max() == pytest.approx(1500.0, rel=1e-2)


def test_faults_of_one_folder_come_together(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("missing file", "quantity not positive"):
        MISTAKES[name][0]()
    replace(TABLE, "creep_2500V,creep", "creep_2500V,crep")()
    replace("data/tubular/records/creep_2000V.csv", "[kV]", "[kN]")()
    said = message(capsys, "check", "data/tubular")
    for word in ("thickness", "line 3, protocol", "creep_1500V.csv", "'kN' is a force"):
        assert word in said
    assert said.count("\n") == 4
