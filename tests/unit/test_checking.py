"""`deabayes check` and `deabayes new`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.unit.study_folders import HEADER, make_folder, record_lines, replace_in, write_lines

from deabayes.checks.folder import check_folder
from deabayes.checks.study import check_names, check_study
from deabayes.cli import main
from deabayes.faults import UserError
from deabayes.scaffold import new_study
from deabayes.study import Sampling, Study
from deabayes.systems import REGISTRY

REAL_DATA = Path(os.environ.get("DEABAYES_DATA", Path(__file__).parents[3] / "shared" / "data"))
SPECIMENS = Path(__file__).parents[2] / "data"


def test_report_says_what_was_understood(tmp_path: Path) -> None:
    report = check_folder(make_folder(tmp_path))
    assert report.ok
    text = report.text()
    for words in (
        "strip A: tensile_strip, measured",
        "gauge_length = 80 mm (exact)",
        "cross_section = 22 ± 1.1 mm² (a parameter)",
        "instrument force.noise = 1 mN",
        "relax: relaxation, calibrate, displacement -> force",
        "40 rows, 3.9 s, sampled at 10 Hz",
        "displacement from 0 to 60 mm",
        "stretch_rate_per_s 0.05",
        "0 faults, 0 warnings",
    ):
        assert words in text


def test_a_plain_number_has_no_unit_behind_it(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    rows = [f"{i / 10},{1 + i / 20},{i * i}" for i in range(41)]
    write_lines(folder / "records" / "relax.csv", ["time [s],stretch [1],force [mN]", *rows])
    text = (folder / "experiments.csv").read_text()
    head, relax = text.splitlines()[0], next(r for r in text.splitlines() if "relax.csv" in r)
    write_lines(folder / "experiments.csv", [head, relax.replace("displacement", "stretch")])
    assert "stretch from 1 to 3\n" in check_folder(folder).text()


def test_small_and_large_values_are_shown_with_a_prefix(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "value: 80, unit: mm", "value: 80, unit: um")
    replace_in(folder / "specimen.yaml", "sd: 1.1", "sd: 254")
    text = check_folder(folder).text()
    assert "gauge_length = 80 µm (exact)" in text
    assert "± 250 mm² (a parameter)" in text


def test_report_holds_every_fault_and_still_shows_the_rest(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "gauge_length", "gage_length")
    write_lines(folder / "records" / "relax.csv", record_lines(1, rows=2))
    replace_in(folder / "records" / "pull.csv", "\n1.0000,", "\n1.0500,")
    report = check_folder(folder)
    assert not report.ok
    assert len(report.faults) == 2
    text = report.text()
    assert "relax: relaxation, calibrate, displacement -> force (cannot be used" in text
    assert "pull: load_unload" in text
    assert "gage_length" in text
    assert "gage_length" not in report.text(with_faults=False)


def test_warnings_are_shown(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "value: 10, unit: N", "value: 1.15, unit: N")
    lines = [line for i, line in enumerate(record_lines(2)) if not 20 <= i < 35]
    write_lines(folder / "records" / "pull.csv", lines)
    report = check_folder(folder)
    assert report.ok
    assert any("(relax), column force" in w and "clipped" in w for w in report.warnings)
    assert any("(pull): a gap of 1.6 s" in w for w in report.warnings)
    assert "Warnings" in report.text()


def test_amplifier_at_its_limit_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    with (folder / "specimen.yaml").open("a") as stream:
        stream.write("  current_limit: {value: 120, unit: mA}\n")
    lines = [f"{line},{120 if i < 4 else 0}" for i, line in enumerate(record_lines(1)[1:])]
    write_lines(folder / "records" / "relax.csv", [f"{HEADER},current [mA]", *lines])
    (warning,) = check_folder(folder).warnings
    assert "current limit of 120 mA in 10.00%" in warning


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
            {"select": {"note": "first", "stretch_rate_per_s": "0.05"}},
            ["no experiment with all of these values"],
        ),
        ({"select": {"stretch_rate_per_s": "5e-2"}}, ["no record to calibrate on"]),
    ],
)
def test_faults_of_a_study(tmp_path: Path, settings: dict[str, object], words: list[str]) -> None:
    given = {"candidates": ("kv_gm_1",), **settings}
    study = Study("s", make_folder(tmp_path), **given)  # type: ignore[arg-type]
    faults, _ = check_study(study)
    assert len(faults) == 1
    for word in words:
        assert word in faults[0]


def test_too_few_points_for_a_candidate(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    write_lines(folder / "records" / "relax.csv", record_lines(1, rows=11))
    faults, _ = check_study(Study("s", folder, ("kv_gm_1", "kv_gm_4")))
    assert len(faults) == 1
    assert "study s, kv_gm_4: 9 points cannot determine" in faults[0]  # 2 at the ramp's end masked


def test_too_few_walkers_for_a_candidate(tmp_path: Path) -> None:
    sampling = Sampling(walkers=22)
    study = Study("s", make_folder(tmp_path), ("kv_gm_1", "kv_gm_2"), sampling=sampling)
    (fault,) = check_study(study)[0]
    assert "study s, kv_gm_2, sampling.walkers: 22 are too few for 12 parameters" in fault
    assert "at least 24" in fault


def test_an_sd_beyond_the_value_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    assert check_folder(folder).warnings == ()
    replace_in(folder / "specimen.yaml", "sd: 1.1", "sd: 30")
    (warning,) = check_folder(folder).warnings
    assert "specimen.yaml, quantities.cross_section: its sd is 1.36 times its value" in warning


def test_a_step_that_leaves_nothing_says_what_there_was(tmp_path: Path) -> None:
    steps = {"relaxation": [{"mask_before": {"time": "5 h"}}]}
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), preparation=steps)
    (fault,) = check_study(study)[0]
    assert "step 'mask_before' leaves no sample of those from 0 to 3.9 s; change its" in fault


def test_further_experiments_of_a_study_are_checked_before_a_job(tmp_path):
    asked = {"longer": {"like": "relax", "duration": 2}, "slow": {"like": "pull", "duration": 2},
             "other": {"like": "puls"}}  # fmt: skip
    study = Study("s", make_folder(tmp_path), ("kv_gm_1",), further_experiments=asked)
    slow, other = check_names(study)
    assert "study s, further_experiments: slow: pull (load_unload) does not end with a" in slow
    assert "other: like 'puls' is no record of it; did you mean 'pull'" in other
    assert set(check_study(study)[0]) >= {slow, other}


def test_roles_of_the_study_count_for_repeated_records(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "experiments.csv", "validate", "calibrate")
    (folder / "records" / "pull.csv").write_bytes((folder / "records" / "relax.csv").read_bytes())
    assert check_study(Study("s", folder, ("kv_gm_1",)))[0] == []
    study = Study("s", folder, ("kv_gm_1",), calibrate=("relax",), validate=("pull",))
    (fault,) = check_study(study)[0]
    assert "study s: validate record 'pull' holds the same values" in fault


def test_short_record_is_a_warning_of_a_study(tmp_path: Path) -> None:
    faults, warnings = check_study(Study("s", make_folder(tmp_path), ("kv_gm_2",)))
    assert faults == []
    assert len(warnings) == 1
    assert "kv_gm_2, the longest record: lasts 3.9 s" in warnings[0]
    short = {"tau_beta": {"distribution": "loguniform", "lower": "0.1 s", "upper": "2 s"}}
    own = Study("s", tmp_path / "strip", ("kv_gm_2",), priors=short)
    assert check_study(own) == ([], [])


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
    assert not [line for line in check_study(study)[1] if "prior expects" in line]
    faults, warnings = check_study(study, compare=True)
    found = [line for line in warnings if "prior expects" in line]
    assert faults == [] and len(found) == (said is not None)
    assert said is None or f"s, kv_gm_1, relax: force {said}, where" in found[0]


def test_a_held_out_record_is_held_against_the_prior_too(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "force: {noise: {value: 1, unit: mN}, range: {value: 10,"
               " unit: N}}", "force: {}")  # fmt: skip
    replace_in(folder / "records" / "pull.csv", "force [N]", "force [kN]")
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True)[1]
    (found,) = [line for line in warnings if "prior expects" in line]
    assert "s, kv_gm_1, pull: force reaches" in found


def test_a_response_of_the_wrong_sign_is_a_warning(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    first, *rows = record_lines(1)
    turned = [",".join([*cells[:2], f"-{cells[2]}"]) for cells in (row.split(",") for row in rows)]
    write_lines(folder / "records" / "relax.csv", [first, *(t.replace("--", "") for t in turned)])
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True)[1]
    (found,) = [line for line in warnings if "relax: " in line]
    assert "force falls where the prior expects it to rise; is its sign right?" in found


def test_a_record_that_no_draw_of_the_prior_has_a_response_to(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "unit: mm, source: ruler", "unit: um, source: ruler")
    warnings = check_study(Study("s", folder, ("kv_gm_1",)), compare=True)[1]
    (found,) = [line for line in warnings if "relax: " in line]
    assert "0 of 200 draws of the prior have a response to it; are the units" in found


def test_warnings_of_a_study_stand_under_a_heading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_folder(tmp_path)
    config = tmp_path / "config.yaml"
    config.write_text("studies: {s: {specimen: strip, candidates: [kv_gm_2]}}\n")
    main(["check", "s", "--config", str(config)])
    said = capsys.readouterr().out
    assert "\n\n1 warning on study s\n  - study s, kv_gm_2, the longest record: lasts" in said


@pytest.mark.parametrize("system", REGISTRY)
def test_new_study_only_needs_filling_in(tmp_path: Path, system: str) -> None:
    entry = new_study("mine", system, tmp_path)
    said, entry = entry.split("\n", 1)
    assert said.startswith("# Add this under `studies:`")
    assert entry.startswith("  mine:\n    specimen: ")
    assert "candidates: [" in entry
    report = check_folder(tmp_path / "mine")
    left = [f for f in report.faults if "expected a number, found '...'" not in f]
    assert len(left) == 1
    assert "there is no such file" in left[0]
    with pytest.raises(UserError, match="exists already and is not overwritten"):
        new_study("mine", system, tmp_path)


def test_a_candidate_of_another_system_is_said_to_be(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    for candidate in ("voigt_kelvin_2", "voigt_kelvin_2_inertia_circuit"):
        (fault,) = check_study(Study("s", folder, (candidate,)))[0]
        assert f"candidate '{candidate}' belongs to system 'tubular', and the" in fault
    (fault,) = check_study(Study("s", folder, ("kvgm_2",)))[0]
    assert "unknown candidate 'kvgm_2'; did you mean 'kv_gm_2'?" in fault
    (fault,) = check_study(Study("s", folder, ("voigt",)))[0]
    assert "unknown candidate 'voigt'; known: " in fault


def test_new_study_refuses_names_and_systems(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"'a/b' cannot be a study's name"):
        new_study("a/b", "tubular", tmp_path)
    with pytest.raises(UserError, match=r"unknown system 'tubula'; did you mean 'tubular'"):
        new_study("a", "tubula", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", sorted(p.parent.name for p in SPECIMENS.glob("*/specimen.yaml")))
def test_every_shipped_folder_is_sound(folder: str) -> None:
    from deabayes.reading.download import missing_data

    path = SPECIMENS / folder
    if missing_data(path, REAL_DATA):
        pytest.skip("public data not here")
    report = check_folder(path, REAL_DATA)
    assert report.faults == ()


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
    faults, _ = check_study(study)
    assert len(faults) == (1 if words else 0), faults
    for word in words:
        assert word in faults[0]
