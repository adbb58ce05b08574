"""What a command reads is not written over, whatever `-o` says."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder

from deabayes.cli.main import main

SIMULATE = ("simulate", "tensile_strip", "kv_gm_1", "--specimen", "strip", "--excitation")
RECORD = "strip/records/relax.csv"
POSTERIOR = "fit/one/posterior.nc"
READ = {
    RECORD: (*SIMULATE, RECORD),
    "strip/../strip/records/relax.csv": (*SIMULATE, RECORD),
    "strip/specimen.yaml": (*SIMULATE, RECORD),
    "link.csv": (*SIMULATE, RECORD),
    POSTERIOR: ("export", POSTERIOR, "--to", "csv"),
    "fit/one/../one/posterior.nc": ("score", POSTERIOR, "--prepared", "prepared"),
    f"fit/../{POSTERIOR}": ("nested", POSTERIOR, "--prepared", "prepared"),
    "fit/../fit/one/../one/posterior.nc": ("compare", POSTERIOR, "--prepared", "prepared"),
    "prepared": ("predict", POSTERIOR, "--prepared", "prepared"),
}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a study folder, prepared records and what may be a posterior."""
    make_folder(tmp_path)
    (tmp_path / "link.csv").symlink_to(RECORD)
    (tmp_path / "prepared").mkdir()
    (tmp_path / POSTERIOR).parent.mkdir(parents=True)
    (tmp_path / POSTERIOR).write_text("draws")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 1
    return capsys.readouterr().err


@pytest.mark.parametrize("output", READ)
def test_what_is_read_is_not_written_over(
    place: Path, capsys: pytest.CaptureFixture[str], output: str
) -> None:
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    said = refusal(capsys, *READ[output], "-o", output)
    kind = "folder" if output == "prepared" else "file"
    assert said == f"deabayes: -o {output}: this {kind} is an input; name another {kind}\n"
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before


def test_the_table_of_errors_is_not_written_over_the_posterior(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refusal(capsys, "predict", POSTERIOR, "--prepared", "prepared", "--errors", POSTERIOR)
    assert said.startswith(f"deabayes: --errors {POSTERIOR}: this file is an input")


@pytest.mark.parametrize(
    ("output", "said"),
    [
        ("strip", "this folder is an input; name another folder"),
        ("strip/../strip/records", "this folder is an input; name another folder"),
        ("strip/specimen.yaml", "is a file; name a folder"),
    ],
)
def test_records_are_not_prepared_into_the_folder_of_the_study(
    place: Path, capsys: pytest.CaptureFixture[str], output: str, said: str
) -> None:
    (place / "config.yaml").write_text("studies: {s: {specimen: strip, candidates: [kv_gm_1]}}\n")
    assert refusal(capsys, "prepare", "s", "-o", output) == f"deabayes: -o {output}: {said}\n"
    assert not list((place / "strip").rglob("*.nc"))


@pytest.mark.parametrize(
    ("command", "output", "said"),
    [
        ("figures", "strip", "holds specimen.yaml; name a folder that holds only figures"),
        ("figures", "fit", "holds study.yaml; name a folder that holds only figures"),
        ("figures", "fit/analyses", "its index.json lists no figures; name another folder"),
        ("figures", "link.csv", "is a file; name a folder"),
        ("analyse", "strip", "holds specimen.yaml; name a folder that holds only analyses"),
        ("analyse", "strip/records", "the command would delete this folder with pull.csv; name a"),
        ("analyse", "fit/figures", "its index.json lists no analyses; name another folder"),
        ("analyse", ".", "the command would delete this folder with fit; name a new folder"),
    ],
)
def test_figures_and_analyses_have_a_folder_of_their_own(
    place: Path, capsys: pytest.CaptureFixture[str], command: str, output: str, said: str
) -> None:
    (place / "fit" / "study.yaml").touch()
    for name, key in (("analyses", "tables"), ("figures", "svg")):
        (place / "fit" / name).mkdir()
        (place / "fit" / name / "index.json").write_text(f'[{{"{key}": []}}]')
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert refusal(capsys, command, "fit", "-o", output).startswith(
        f"deabayes: -o {output}: {said}"
    )
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("there", [None, "", '[{"svg": "", "tables": []}]'])
def test_a_new_folder_and_one_that_was_written_before_are_taken(
    place: Path, monkeypatch: pytest.MonkeyPatch, there: str | None
) -> None:
    asked: list[Path] = []
    monkeypatch.setattr("deabayes.pipeline.draw_figures", lambda *given: asked.append(given[1]))
    monkeypatch.setattr("deabayes.pipeline.analyse_study", lambda *given: asked.append(given[1]))
    if there is not None:
        (place / "new").mkdir()
    if there:
        (place / "new" / "index.json").write_text(there)
        (place / "new" / "pull_in").mkdir()
    main(["figures", "fit", "-o", "new"])
    main(["analyse", "fit", "-o", "new"])
    assert asked == [Path("new"), Path("new")]


@pytest.mark.parametrize(("more", "named"), [((), False), (("--names",), True)])
def test_names_are_drawn_if_the_command_asks_for_them(
    place: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...], named: bool
) -> None:
    asked: list[object] = []
    monkeypatch.setattr("deabayes.figures.save_all", lambda *given: asked.extend(given))
    monkeypatch.setattr("deabayes.pipeline.publish.check_as_fitted", lambda results: None)
    main(["figures", "fit", "-o", "new", *more])
    assert asked == [Path("fit"), Path("new"), named]
