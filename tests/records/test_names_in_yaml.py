"""Names that YAML does not read as a text, and templates that can be read back."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.shared.study_folders import make_folder, replace_in

from deabayes.cli.main import main
from deabayes.faults import UserError, closest, nearest
from deabayes.records.scaffold import new_study
from deabayes.records.schema import read_yaml, scalar
from deabayes.records.specimen import read_specimen
from deabayes.studies import load_studies

UNREAD = {"2024-05-13": "a date", "2024": "a number", "on": "true or false", "1.5": "a number"}


def config(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", UNREAD)
def test_a_study_whose_name_is_no_text(tmp_path: Path, name: str) -> None:
    make_folder(tmp_path)
    entry = "{specimen: strip, candidates: [kv_gm_1]}"
    with pytest.raises(UserError) as caught:
        load_studies(config(tmp_path, f"studies: {{{name}: {entry}}}"))
    assert "config.yaml, studies: the key " in str(caught.value)
    assert f"is {UNREAD[name]} to YAML; write it in quotes" in str(caught.value)
    (study,) = load_studies(config(tmp_path, f"studies: {{'{name}': {entry}}}"))
    assert study.name == name


@pytest.mark.parametrize(
    ("text", "under"),
    [
        ("studies: {s: STUDY}\nsampling: {ensembles: 2, mine: STUDY}", ", sampling"),
        ("studies: {s: STUDY}\nmine: STUDY", ""),
    ],
)
def test_a_study_that_is_not_under_studies(tmp_path: Path, text: str, under: str) -> None:
    entry = "{specimen: strip, candidates: [kv_gm_1]}"
    with pytest.raises(UserError) as caught:
        load_studies(config(tmp_path, text.replace("STUDY", entry)))
    assert f"config.yaml{under}: 'mine' is a study, which belongs under `studies:`" in str(
        caught.value
    )


@pytest.mark.parametrize("value", ["40,0, unit: mm", "40,0 unit: mm", "40,05, unit: mm"])
def test_a_decimal_comma(tmp_path: Path, value: str) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "value: 80, unit: mm", f"value: {value}")
    with pytest.raises(UserError) as caught:
        read_specimen(folder)
    said = "gauge_length: the comma after `value: 40` ends the number; write a decimal point"
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", UNREAD)
def test_a_specimen_whose_name_is_no_text(tmp_path: Path, name: str) -> None:
    path = make_folder(tmp_path) / "specimen.yaml"
    path.write_text(path.read_text().replace("name: strip A", f"name: {name}"))
    with pytest.raises(UserError, match=f"which is {UNREAD[name]}: write it in quotes"):
        read_specimen(path.parent)


@pytest.mark.parametrize("name", [*UNREAD, "1e3", "null", "a"])
@pytest.mark.parametrize("parent", ["data", "Daten #2", "it's: here"])
def test_a_template_says_the_name_it_was_given(tmp_path: Path, name: str, parent: str) -> None:
    entry = new_study(name, "tubular", tmp_path / parent)
    content = read_yaml(config(tmp_path, f"studies:\n{entry}"))["studies"]
    assert list(content) == [name]
    assert content[name]["specimen"] == (tmp_path / parent / name).as_posix()
    written = tmp_path / parent / name / "specimen.yaml"
    assert read_yaml(written)["name"] == name


@pytest.mark.parametrize("name", ["Prüfling", "", "a b", ".a", "a/b", "a\n"])
def test_no_template_for_a_name_that_no_config_takes(tmp_path: Path, name: str) -> None:
    with pytest.raises(UserError, match="cannot be a study's name"):
        new_study(name, "tubular", tmp_path)
    assert not list(tmp_path.iterdir())


def test_any_text_is_read_back() -> None:
    for text in ("a", "2024", "~", "it's", "a: b", "[", "- a", " a ", "x #y", "@", "1e3"):
        assert yaml.safe_load(f"key: {scalar(text)}") == {"key": text}


def test_a_name_may_be_compared_with_what_is_none() -> None:
    assert closest(2024, ["2023", 2025]) is not None
    assert "known: 1, b" in nearest("zzz", [1, "b"])
    assert nearest("zzz", []) == ""


def test_the_command_line_says_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    config(tmp_path, "studies: {2024: {specimen: strip, candidates: [kv_gm_1]}}")
    with pytest.raises(SystemExit):
        main(("check", "2024"))
    assert "the key 2024 is a number to YAML" in capsys.readouterr().err


def test_a_study_called_as_its_folder_is_checked_with_its_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_folder(tmp_path)
    monkeypatch.chdir(tmp_path)
    config(tmp_path, "studies: {strip: {specimen: strip, candidates: [kv_gn_1]}}")
    with pytest.raises(SystemExit):
        main(("check", "strip"))
    assert "study strip, candidates" in capsys.readouterr().err
    main(("check", "./strip"))


def test_a_config_that_is_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The config in it is named, if there is one."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "config.yaml").write_text("studies: {}\n")
    (tmp_path / "bare").mkdir()
    monkeypatch.chdir(tmp_path)
    for folder, hint in (("here", f", {Path('here', 'config.yaml')}"), ("bare", "")):
        with pytest.raises(SystemExit):
            main(("check", "strip", "--config", folder))
        said = capsys.readouterr().err
        assert said == f"deabayes: {folder}: is a folder; name a file{hint}\n"


def test_a_config_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(("check", "strip"))
    said = capsys.readouterr().err
    assert said.startswith("deabayes: config.yaml: there is no such file; correct the path")
    assert "deabayes new" not in said
