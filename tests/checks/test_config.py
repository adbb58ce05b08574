"""Studies of one config are loaded and checked each for itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder, record_lines, replace_in, write_lines

from deabayes.checks.config import CheckedConfig, check_config, load_config, only_asked
from deabayes.faults import Faults
from deabayes.records.schema import read_yaml

RESULTS = Path("results")
CONFIG = """\
studies:
  sound: {specimen: strip, candidates: [kv_gm_1]}
  schema: {specimen: strip, candidtaes: [kv_gm_1]}
  names: {specimen: strip, candidates: [kv_gn_1]}
  tables: {specimen: torn, candidates: [kv_gm_1]}
  after: {specimen: strip, calibrate: [pull], validate: [], candidates: [kv_gm_1],
          prior_from: results/names/kv_gm_1/posterior.nc}
  last: {specimen: strip, calibrate: [more], validate: [], candidates: [kv_gm_1],
         prior_from: results/after/kv_gm_1/posterior.nc}
populations:
  pair: {studies: [sound, names], candidate: kv_gm_1, parameters: [mu_alpha]}
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    records = make_folder(tmp_path) / "records"
    write_lines(records / "more.csv", record_lines(3))
    with (tmp_path / "strip" / "experiments.csv").open("a") as table:
        table.write("more,relaxation,records/more.csv,validate,displacement,force,,\n")
    make_folder(tmp_path / "other")
    (tmp_path / "other" / "strip").rename(tmp_path / "torn")
    replace_in(tmp_path / "torn" / "experiments.csv", "load_unload", "lode_unload")
    (tmp_path / "config.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def loaded() -> CheckedConfig:
    return load_config(read_yaml(Path("config.yaml")), "config.yaml")


def checked(*targets: str) -> CheckedConfig:
    found = loaded()
    only_asked(found, targets, RESULTS)
    check_config(found, RESULTS)
    return found


def test_each_fault_is_of_its_study_and_the_sound_one_is_left(place: Path) -> None:
    found = checked()
    assert list(found.studies) == ["sound"]
    assert set(found.faults) == {"schema", "names", "tables", "after", "last"}
    assert "'candidtaes'; did you mean 'candidates'?" in found.faults["schema"][0]
    assert "kv_gn_1" in found.faults["names"][0]
    assert "lode_unload" in found.faults["tables"][0]
    assert "study 'names' has a fault of its own" in found.faults["after"][0]
    assert "study 'after' has a fault of its own" in found.faults["last"][0]
    assert found.left_out == ["population pair left out: its studies names have faults"]


def test_a_study_of_a_target_is_checked_with_what_it_needs_and_no_other(place: Path) -> None:
    assert checked("results/sound/figures").faults == {}
    assert checked("results/sound/figures").left_out == []
    found = checked("results/last/comparison.csv")
    assert set(found.faults) == {"names", "after", "last"}
    assert found.studies == {}
    assert set(checked("results/report/index.html").faults) == set(checked().faults)


def test_a_target_of_no_study_names_the_nearest(place: Path) -> None:
    with pytest.raises(Faults, match=r"results/sounds/figures: there is no study 'sounds'; did"):
        only_asked(loaded(), ["results/sounds/figures"], RESULTS)


def test_a_population_with_a_fault_leaves_its_studies(place: Path) -> None:
    replace_in(place / "config.yaml", "[sound, names]", "[sound, third]")
    more = "  third: {specimen: strip, calibrate: [pull], validate: [], candidates: [kv_gm_1]}\n"
    replace_in(place / "config.yaml", "populations:\n", f"{more}populations:\n")
    found = checked("results/populations/pair/figures")
    assert list(found.studies) == ["sound", "third"] and found.populations == {}
    assert "2 specimens are too few" in found.faults["populations/pair"][0]


def test_a_fault_outside_the_studies_ends_all(place: Path) -> None:
    replace_in(place / "config.yaml", "studies:\n", "data_rot: x\nstudies:\n")
    with pytest.raises(Faults, match="data_rot"):
        loaded()


def test_a_config_in_which_no_study_loads_is_one_message(place: Path) -> None:
    text = "studies: {a: {specimen: strip}, b: {candidates: [kv_gm_1]}}\n"
    (place / "config.yaml").write_text(text)
    with pytest.raises(Faults) as raised:
        loaded()
    assert len(raised.value.faults) == 2


def test_public_data_that_are_not_here_leave_a_study_out(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = "no records: make data"
    monkeypatch.setattr(
        "deabayes.checks.config.missing_data",
        lambda folder, root: why if folder.name == "torn" else None,
    )
    found = checked()
    assert "tables" not in found.studies and "tables" not in found.faults
    assert found.left_out[0] == f"tables left out: {why}"
    assert checked("results/sound/figures").left_out == []
    with pytest.raises(Faults, match=f"results/tables/figures: .*{why}"):
        only_asked(loaded(), ["results/tables/figures"], RESULTS)
