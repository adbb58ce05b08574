"""Which records a study takes, and for what: `select`, `split_by`, `calibrate`, `validate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.shared.study_folders import make_config, replace_in

from deabayes.faults import Report, UserError
from deabayes.studies import load_studies


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return make_config(tmp_path)


def test_split_by_a_column(config: Path) -> None:
    folder = config.parent / "strip"
    replace_in(folder / "experiments.csv", "note,stretch_rate_per_s", "material,note")
    replace_in(folder / "experiments.csv", "force,first,", "force,Soft 00-30,")
    replace_in(folder / "experiments.csv", "force,,0.25", "force,Hard,")
    further = "further_experiments: {again: {like: relax}, misspelt: {like: relaks}}"
    asked = f"calibrate: [relax, relacks], validate: [], {further}"
    config.write_text(
        f"studies: {{s: {{specimen: strip, candidates: [gent], split_by: material, {asked}}}}}"
    )
    from deabayes.checks.study import check_names

    soft, hard = load_studies(config)
    assert set(soft.further_experiments) == {"again", "misspelt"}
    assert set(hard.further_experiments) == {"misspelt"}, "its record is not of this part"
    assert (soft.calibrate, hard.calibrate) == (("relax", "relacks"), ("relacks",))
    assert soft.validate == hard.validate == ()
    assert "no experiment 'relacks'; did you mean 'relax'?" in " ".join(check_names(soft))
    assert (soft.name, soft.select) == ("s_Soft_00-30", {"material": "Soft 00-30"})
    assert (hard.name, hard.select) == ("s_Hard", {"material": "Hard"})
    config.write_text("studies: {s: {specimen: strip, candidates: [gent], split_by: materiel}}")
    with pytest.raises(UserError, match=r"no column 'materiel' to split by; did you mean 'mater"):
        load_studies(config)


def test_an_empty_list_holds_nothing_out(config: Path) -> None:
    """As `deabayes check` understands it; a list that is not given leaves it to the role column."""
    from deabayes.pipeline import select_rows
    from deabayes.records.table import read_table

    (study,) = load_studies(config)
    rows = read_table(study.specimen)

    def held_out(validate: tuple[str, ...] | None) -> list[str]:
        chosen = select_rows(replace(study, validate=validate), rows)
        return [row.name for row in chosen if row.role == "validate"]

    assert held_out(()) == []
    assert held_out(("pull",)) == ["pull"]
    assert held_out(None) == [row.name for row in rows if row.role == "validate"] != []


def test_studies_of_one_protocol_or_response(config: Path) -> None:
    from deabayes.checks.study import check_study
    from deabayes.records.table import read_table, selected

    entry = "{specimen: strip, candidates: [kv_gm_1], split_by: protocol}"
    config.write_text(f"studies: {{s: {entry}}}")
    relaxation, load_unload = load_studies(config)
    assert (relaxation.name, relaxation.select) == ("s_relaxation", {"protocol": "relaxation"})
    rows = read_table(relaxation.specimen)
    assert [row.name for row in selected(rows, load_unload.select)] == ["pull"]
    config.write_text(
        f"studies: {{s: {entry.replace('split_by: protocol', 'select: {response: force}')}}}"
    )
    (study,) = load_studies(config)
    assert selected(rows, study.select) == rows
    assert check_study(study).faults == []


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"calibrate": None, "validate": ("relax",)},
            ["name one of its records under `calibrate`, and not under `validate`"],
        ),
        ({"calibrate": ("pull",), "validate": None}, []),
        ({"calibrate": None, "validate": None}, []),
    ],
)
def test_a_listed_record_has_the_role_of_its_list(
    config: Path, given: dict[str, tuple[str, ...] | None], words: list[str]
) -> None:
    """Where the other list is not given, the role column does not take it back."""
    from deabayes.checks.study import used_rows
    from deabayes.pipeline import select_rows
    from deabayes.records.folder import read_folder

    (study,) = load_studies(config)
    study = replace(study, **given)  # type: ignore[arg-type]
    report = Report()
    read = read_folder(study.specimen)
    used = used_rows(study, read, report)
    roles = {row.name: row.role for row in used}
    for role in ("calibrate", "validate"):
        assert all(roles[name] == role for name in given[role] or ())
    assert [word for fault in report.faults for word in words if word in fault] == words
    if words:
        with pytest.raises(UserError, match=words[0]):
            select_rows(study, read.table)
    else:
        assert select_rows(study, read.table) == used
