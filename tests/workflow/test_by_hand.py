"""Stages run by hand: what they leave behind, and what is said where they cannot begin."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.shared.study_folders import make_folder, replace_in

from deabayes import api, pipeline
from deabayes.cli.fitting import fit_by_name
from deabayes.cli.main import main
from deabayes.studies import load_studies, load_study

CONFIG = """\
pathvars: {results: elsewhere}
studies:
  vhb:
    specimen: strip
    candidates: [kv_gm_1, kv_gm_2]
    sampling: {ensembles: 2}
  parts:
    specimen: strip
    split_by: batch
    candidates: [ogden_1]
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a configuration and a study folder of two batches."""
    table = make_folder(tmp_path) / "experiments.csv"
    replace_in(table, "stretch_rate_per_s", "stretch_rate_per_s,batch")
    replace_in(table, "first,", "first,,rtv615")
    replace_in(table, "0.25", "0.25,p7670")
    (tmp_path / "config.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_speaks_to_snakemake_alone_is_passed_over(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["check", "vhb"])
    assert "strip" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments", [("check", "parts"), ("data", "parts"), ("fit", "parts", "ogden_1")]
)
def test_of_a_split_study_the_parts_are_named(
    place: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    replace_in(place / "config.yaml", "pathvars: {results: elsewhere}\n", "")
    with pytest.raises(SystemExit):
        main(arguments)
    said = capsys.readouterr().err
    assert "parts is split into parts_rtv615, parts_p7670; name one of them" in said


def test_a_fit_by_hand_writes_the_settings_that_analyse_reads(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_in(place / "config.yaml", "pathvars: {results: elsewhere}\n", "")
    for stage in ("prepare_study", "fit_candidate"):
        monkeypatch.setattr(pipeline, stage, lambda *_, **__: None)
    monkeypatch.setattr(
        api, "open_posterior", lambda _: SimpleNamespace(converged=True, leaning=())
    )
    fit_by_name("vhb", "kv_gm_1", Path("config.yaml"), Path("results"))
    path = Path("results/vhb/study.yaml")
    assert load_study(path) == load_studies(Path("config.yaml"))[0]
    path.write_text(f"{path.read_text()}\n")  # as the workflow writes it
    fit_by_name("vhb", "kv_gm_2", Path("config.yaml"), Path("results"))
    assert path.read_text().endswith("\n\n")
    replace_in(Path("config.yaml"), "ensembles: 2", "ensembles: 3")
    fit_by_name("vhb", "kv_gm_2", Path("config.yaml"), Path("results"))
    assert load_study(path).sampling.ensembles == 3


def test_a_study_is_reported_once_however_it_is_spelt(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path] = []
    monkeypatch.setattr(pipeline, "build_report", lambda *given: asked.extend(given[0]))
    for name in ("one", "two"):
        Path("results", name).mkdir(parents=True)
    main(["report", "two", "one", "results/two", "strip/../results/one", "two"])
    assert asked == [Path("results/two"), Path("results/one")]


@pytest.mark.parametrize(("given", "tables"), [((), "page/tables"), (("--tables", "t"), "t")])
def test_tables_of_a_report_are_beside_its_page(
    place: Path, monkeypatch: pytest.MonkeyPatch, given: tuple[str, ...], tables: str
) -> None:
    asked: list[Path] = []
    monkeypatch.setattr(pipeline, "build_report", lambda *given: asked.extend(given[1:3]))
    main(["report", "strip", "-o", "page/index.html", *given])
    assert asked == [Path("page/index.html"), Path(tables)]
