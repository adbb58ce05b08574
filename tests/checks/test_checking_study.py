"""`deabayes check` of a study: its settings, candidates and records against one another."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.study_folders import SPECIMENS, make_folder, record_lines, replace_in, write_lines

from deabayes.checks.study import check_names, check_study
from deabayes.cli.main import main
from deabayes.study import Study

PRIOR = {"distribution": "lognormal", "median": 50, "sigma": 0.5}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"noise": "whit"}, ["noise: unknown 'whit'", "'white'?"]),
        (
            {"preparation": {"relaxation": [{"crop": {"form": "1 s"}}]}},
            ["'form'", "'from'"],
        ),
        ({"preparation": {"relaxation": [{"crop": {"from": "1 V"}}]}}, ["crop.from", "a voltage"]),
        ({"priors": {"J_alfa": PRIOR}}, ["study s, priors.J_alfa", "'J_alpha'"]),
        ({"priors": {"mu_beta_9": PRIOR}}, ["study s, priors.mu_beta_9", "no parameter"]),
        ({"priors": {"J_alpha": {"distribution": "lognrmal"}}}, ["'lognrmal'", "'lognormal'?"]),
        ({"preparation": {"relaxation": [{"averag": {}}]}}, ["unknown step 'averag'", "'average'"]),
        (
            {"preparation": {"creep": [{"decimate": {"every": 2}}]}},
            ["study s, preparation: ", "no model of protocol 'creep'", "it has relaxation"],
        ),
        (
            {"preparation": {"relaxation": [{"average": {"grid": "uniform", "points": 5}}]}},
            ["study s, kv_gm_1: 5 points cannot determine 7 parameters"],
        ),
        ({"candidates": ("kv_gn_1",)}, ["candidates", "kv_gn_1"]),
        ({"calibrate": ("relx",)}, ["calibrate", "no experiment 'relx'", "'relax'?"]),
        ({"calibrate": ("relax",), "validate": ("pul",)}, ["validate", "'pull'?"]),
        ({"select": {"note": "second"}}, ["no experiment with note 'second'", "known: first"]),
        ({"select": {"nope": "1"}}, ["study s, select: ", "no column 'nope' in experiments.csv"]),
        ({"select": {"nots": "first"}}, ["did you mean 'note'?"]),
        (
            {"select": {"note": "first", "stretch_rate_per_s": "0.25"}},
            ["no experiment with all of these values"],
        ),
        ({"select": {"response": "fors"}}, ["no experiment with response 'fors'", "'force'?"]),
        ({"select": {"stretch_rate_per_s": "2.5e-1"}}, ["no record to calibrate on"]),
    ],
)
def test_faults_of_a_study(tmp_path: Path, settings: dict[str, object], words: list[str]) -> None:
    given = {"candidates": ("kv_gm_1",), **settings}
    study = Study("s", make_folder(tmp_path), **given)  # type: ignore[arg-type]
    faults = check_study(study).faults
    assert len(faults) == 1
    for word in words:
        assert word in faults[0]


def test_too_few_points_for_a_candidate(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    write_lines(folder / "records" / "relax.csv", record_lines(1, rows=11))
    faults = check_study(Study("s", folder, ("kv_gm_1", "kv_gm_4"))).faults
    assert len(faults) == 1
    assert "study s, kv_gm_4: 9 points cannot determine" in faults[0]  # 2 at the ramp's end masked


def test_a_step_that_leaves_nothing_says_what_there_was(tmp_path: Path) -> None:
    steps = {"relaxation": [{"mask_before": {"time": "5 h"}}]}
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), preparation=steps)
    (fault,) = check_study(study).faults
    assert "step 'mask_before' leaves no sample of those from 0 to 3.9 s; change its" in fault


def test_further_experiments_of_a_study_are_checked_before_a_job(tmp_path):
    asked = {"longer": {"like": "relax", "duration": 2}, "slow": {"like": "pull", "duration": 2},
             "other": {"like": "puls"}}  # fmt: skip
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), further_experiments=asked)
    slow, other = check_names(study)
    assert "study s, further_experiments: slow: pull (load_unload) does not end with a" in slow
    assert "other: like 'puls' is not a record of the study; did you mean 'pull'" in other
    assert set(check_study(study).faults) >= {slow, other}


def test_roles_of_the_study_count_for_repeated_records(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "calibrate", "validate")
    (folder / "records" / "pull.csv").write_bytes((folder / "records" / "relax.csv").read_bytes())
    study = Study("s", folder, ("kv_gm_1",), calibrate=("relax",), validate=("pull",))
    (fault,) = check_study(study).faults
    assert "study s: validate record 'pull' holds the same values" in fault
    (twice,) = check_study(Study("s", folder, ("kv_gm_1",), calibrate=("relax", "pull"))).faults
    assert "calibrate record 'pull' holds the same values as calibrate record 'relax'" in twice
    assert "would count twice" in twice


def test_a_prior_of_times_that_no_record_shows_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    fast = {"tau_beta": {"distribution": "loguniform", "lower": "1 ms", "upper": "2 s"}}
    report = check_study(Study("s", folder, ("kv_gm_2",), priors=fast))
    assert report.faults == []
    (warning,) = report.warnings
    assert "kv_gm_2, prior: has time constants from 1.46 ms on" in warning


def test_short_record_is_a_warning_of_a_study(tmp_path: Path) -> None:
    """Where somebody wrote the prior down; default ones follow the records."""
    folder = make_folder(tmp_path)
    report = check_study(Study("s", folder, ("kv_gm_2",)))
    assert report.faults == report.warnings == []
    long = {"tau_beta": {"distribution": "loguniform", "lower": "0.1 s", "upper": "5000 s"}}
    report = check_study(Study("s", folder, ("kv_gm_2",), priors=long))
    faults, warnings = report.faults, report.warnings
    assert faults == []
    assert len(warnings) == 1
    assert "kv_gm_2, the longest record: lasts 3.9 s" in warnings[0]
    short = {"tau_beta": {"distribution": "loguniform", "lower": "0.1 s", "upper": "2 s"}}
    own = Study("s", tmp_path / "strip", ("kv_gm_2",), priors=short)
    report = check_study(own)
    assert report.faults == report.warnings == []


@pytest.mark.parametrize(
    ("unit", "said"), [("N", None), ("mN", "reaches 0.0012 N"), ("kN", "reaches 1.2e+03 N")]
)
def test_a_unit_that_is_a_thousand_off_is_a_warning(
    tmp_path: Path, unit: str, said: str | None
) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "force: {noise: {value: 1, unit: mN}, range: {value: 10,"
               " unit: N}}", "force: {}")  # fmt: skip
    replace_in(folder / "records" / "relax.csv", "force [N]", f"force [{unit}]")
    study = Study("s", folder, ("kv_gm_1", "kv_gm_2"))
    assert not [line for line in check_study(study).warnings if "prior expects" in line]
    report = check_study(study, compare=True)
    faults, warnings = report.faults, report.warnings
    found = [line for line in warnings if "prior expects" in line]
    assert faults == [] and len(found) == (said is not None)
    assert said is None or f"s, kv_gm_1, relax: force {said}, where" in found[0]


def test_a_held_out_record_is_held_against_the_prior_too(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "force: {noise: {value: 1, unit: mN}, range: {value: 10,"
               " unit: N}}", "force: {}")  # fmt: skip
    replace_in(folder / "records" / "pull.csv", "force [N]", "force [kN]")
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True).warnings
    (found,) = [line for line in warnings if "prior expects" in line]
    assert "s, kv_gm_1, pull: force reaches" in found


def test_a_response_of_the_wrong_sign_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    first, *rows = record_lines(1)
    turned = [",".join([*cells[:2], f"-{cells[2]}"]) for cells in (row.split(",") for row in rows)]
    write_lines(folder / "records" / "relax.csv", [first, *(t.replace("--", "") for t in turned)])
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True).warnings
    (found,) = [line for line in warnings if "relax: " in line]
    assert "force falls where the prior expects it to rise; is its sign right?" in found


def test_a_record_that_no_draw_of_the_prior_has_a_response_to(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "unit: mm, source: ruler", "unit: um, source: ruler")
    replace_in(folder / "experiments.csv", ",0.25", ",")
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True).warnings
    (found,) = [line for line in warnings if "relax: " in line]
    assert "0 of 200 draws of the prior have a response to it; are the units" in found


def test_warnings_of_a_study_stand_under_a_heading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_folder(tmp_path)
    config = tmp_path / "config.yaml"
    long = "{tau_beta: {distribution: loguniform, lower: 0.1 s, upper: 5000 s}}"
    config.write_text(
        f"studies: {{s: {{specimen: strip, candidates: [kv_gm_2], priors: {long}}}}}\n"
    )
    main(["check", "s", "--config", str(config)])
    said = capsys.readouterr().out
    assert "\n\n1 warning on study s\n  - study s, kv_gm_2, the longest record: lasts" in said


def test_a_candidate_of_another_system_is_said_to_be(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    for candidate in ("voigt_kelvin_2", "voigt_kelvin_2_inertia_circuit"):
        (fault,) = check_study(Study("s", folder, (candidate,))).faults
        assert f"candidate '{candidate}' belongs to system 'tubular', and the" in fault
    (fault,) = check_study(Study("s", folder, ("kvgm_2",))).faults
    assert "unknown candidate 'kvgm_2' of system 'tensile_strip'; did you mean 'kv_gm_2'?" in fault
    (fault,) = check_study(Study("s", folder, ("voigt",))).faults
    assert "unknown candidate 'voigt' of system 'tensile_strip'; known: " in fault


@pytest.mark.parametrize(
    ("candidates", "calibrate", "words"),
    [
        (("circuit",), ("electrical_10Hz", "leakage_2000V"), ()),
        (("voigt_kelvin_2",), ("creep_2000V", "leakage_2000V"), ("leakage_2000V", "no circuit")),
        (("circuit",), ("leakage_2000V", "creep_2000V"), ("creep_2000V", "'displacement'")),
    ],
)
def test_a_candidate_is_asked_only_for_what_it_computes(
    candidates: tuple[str, ...], calibrate: tuple[str, ...], words: tuple[str, ...]
) -> None:
    study = Study("s", SPECIMENS / "tubular", candidates, calibrate=calibrate, validate=())
    faults = check_study(study).faults
    assert len(faults) == (1 if words else 0), faults
    for word in words:
        assert word in faults[0]
