"""`populations:` of a config: what is understood, and what is said of mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.shared.study_folders import make_folder

from deabayes.cli.main import main
from deabayes.faults import UserError
from deabayes.population.checks import check_population
from deabayes.population.settings import (
    Population,
    load_population,
    load_populations,
    write_population,
)
from deabayes.studies import load_studies

CANDIDATES = ["kv_gm_1", "kv_gm_2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four strips, one of them with records of two batches."""
    parent = tmp_path_factory.mktemp("strips")
    for name in "abcd":
        (parent / name).mkdir()
        strip = make_folder(parent / name)
        table = strip / "experiments.csv"
        head, *rows = table.read_text().splitlines()
        batches = [f"{row},{batch}" for row, batch in zip(rows, ("old", "new"), strict=True)]
        table.write_text("\n".join([f"{head},batch", *batches]).replace("validate", "calibrate"))
    return parent


def config(folder: Path, **population: object) -> Path:
    studies = {f"strip_{n}": {"specimen": f"{n}/strip", "candidates": CANDIDATES} for n in "abcd"}
    studies["strip_d"]["split_by"] = "batch"
    studies["again"] = {"specimen": "a/strip", "candidates": CANDIDATES}
    entry = {
        "studies": ["strip_a", "strip_b", "strip_c"],
        "candidate": "kv_gm_2",
        "parameters": ["mu_alpha", "tau_beta_1", "tau_beta_2"],
    } | population
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({"studies": studies, "populations": {"strips": entry}}))
    return path


def faults(path: Path) -> str:
    try:
        (population,) = load_populations(path)
        return "\n".join(
            check_population(population, {study.name: study for study in load_studies(path)})
        )
    except UserError as error:
        return str(error)


def test_a_sound_entry_is_read_and_written(folder: Path, tmp_path: Path) -> None:
    spread = {"mu_alpha": {"distribution": "halfnormal", "sd": 0.1}}
    path = config(folder, spread=spread, sampling={"ensembles": 2})
    assert faults(path) == ""
    (population,) = load_populations(path)
    assert population.studies == ("strip_a", "strip_b", "strip_c")
    assert population.sampling.ensembles == 2
    write_population(population, tmp_path / "population.yaml")
    assert load_population(tmp_path / "population.yaml") == population
    written = (tmp_path / "population.yaml").stat().st_mtime_ns
    write_population(population, tmp_path / "population.yaml")
    assert (tmp_path / "population.yaml").stat().st_mtime_ns == written


def test_a_split_study_stands_for_its_parts(folder: Path) -> None:
    (population,) = load_populations(config(folder, studies=["strip_a", "strip_d"]))
    assert population.studies == ("strip_a", "strip_d_old", "strip_d_new")
    assert faults(folder / "config.yaml") == ""


def test_a_config_without_populations_has_none(folder: Path) -> None:
    path = folder / "plain.yaml"
    path.write_text("studies: {a: {specimen: a/strip, candidates: [kv_gm_1]}}")
    assert load_populations(path) == ()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"studies": ["strip_a", "strip_b", "stripc"]}, "did you mean 'strip_c'"),
        ({"studies": ["strip_a", "strip_b"]}, "2 specimens are too few to estimate"),
        ({"studies": ["strip_a", "strip_b", "again"]}, "strip_a and again have the same specimen"),
        ({"candidate": "kv_gm_3"}, "no 'kv_gm_3' in strip_a, strip_b, strip_c"),
        ({"parameters": ["mu_alfa"]}, "did you mean 'mu_alpha'"),
        ({"parameters": ["mu_alpha", "relaxation.sigma_ou"]}, "noise belongs to a record"),
        ({"parameters": ["mu_alpha", "tau_beta_1"]}, "tau_beta_2 shares one joint prior"),
        ({"parameters": []}, "parameters: must be a list of at least 1"),
        ({"candidates": ["kv_gm_2"]}, "unknown key 'candidates'; did you mean 'candidate'"),
        ({"spread": {"mu": {"distribution": "halfnormal", "sd": 1}}}, "not under `parameters`"),
        (
            {"spread": {"mu_alpha": {"distribution": "normal", "mean": 0, "sd": 1}}},
            "a spread is not negative",
        ),
        (
            {"spread": {"mu_alpha": {"distribution": "halfnormal", "sd": "5 kPa"}}},
            "spread.mu_alpha",
        ),
    ],
)
def test_a_mistake_is_one_sentence(folder: Path, changed: dict[str, object], said: str) -> None:
    found = faults(config(folder, **changed))
    assert said in found
    assert "populations.strips" in found
    assert len(found.splitlines()) == 1


def ogden(folder: Path, spread: object, priors: object = None, others: object = None) -> str:
    """What is said of a population whose modulus changes its sign with the exponent."""
    path = config(
        folder,
        candidate="ogden_1",
        parameters=["mu_1", "alpha_1"],
        spread={"mu_1": {"distribution": "halfnormal", "sd": spread}},
    )
    content = yaml.safe_load(path.read_text())
    for name, study in content["studies"].items():
        study["candidates"] = ["ogden_1"]
        given = priors if name == "strip_a" else others
        study.update({} if given is None else {"priors": given})
    path.write_text(yaml.safe_dump(content))
    return faults(path)


POSITIVE = {
    "alpha": {"distribution": "uniform", "lower": 1, "upper": 10},
    "sigma_white": {"distribution": "lognormal", "median": 1, "sigma": 1},
}


def test_a_spread_has_the_unit_that_the_fit_takes_it_in(folder: Path) -> None:
    assert ogden(folder, "20 kPa") == ""
    assert "spread.mu_1" in ogden(folder, "20 kPa", POSITIVE, POSITIVE)
    assert ogden(folder, 0.1, POSITIVE, POSITIVE) == ""


def test_a_spread_with_a_unit_needs_its_unit(folder: Path) -> None:
    assert "spread.mu_1: mu_1 can be negative, so its spread is absolute" in ogden(folder, 0.1)


def test_a_parameter_has_one_sign_in_all_studies(folder: Path) -> None:
    found = ogden(folder, 0.1, POSITIVE)
    assert "mu_1 can be negative in strip_b, strip_c but not in strip_a" in found
    assert "alpha_1 can be negative in strip_b, strip_c but not in strip_a" in found


def test_a_study_may_not_take_the_populations_folder(folder: Path) -> None:
    path = config(folder)
    path.write_text(path.read_text().replace("  again:", "  Populations:"))
    assert "rename the study" in faults(path)


def test_a_member_may_not_have_the_population_for_its_prior(folder: Path) -> None:
    path = config(folder)
    content = yaml.safe_load(path.read_text())
    content["studies"]["strip_b"]["prior_from"] = "results/populations/strips/posterior.nc"
    path.write_text(yaml.safe_dump(content))
    assert "count its records twice" in faults(path)


def test_settings_by_hand_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "population.yaml"
    path.write_text("{name: x, studies: [a], candidate: kv_gm_1}")
    with pytest.raises(UserError, match="'parameters' is missing"):
        load_population(path)
    assert Population("x", ("a",), "kv_gm_1", ("mu_alpha",)).spread == {}


def test_the_command_suggests_the_nearest_name(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["population", "stripes", "--config", str(config(folder))])
    assert ended.value.code == 1
    assert "did you mean 'strips'" in capsys.readouterr().err


def test_check_looks_at_a_population_and_all_its_studies(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = config(folder)
    main(("check", "strips", "--config", str(path)))
    said = capsys.readouterr().out
    assert "population strips: 3 specimens by kv_gm_2, mu_alpha, tau_beta_1" in said
    assert [said.count(f"in {folder / n / 'strip'}") for n in "abcd"] == [1, 1, 1, 0]


def test_check_says_what_is_wrong_with_a_population_or_its_studies(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(("check", "strips", "--config", str(config(folder, parameters=["mu_alfa"]))))
    assert "mu_alfa" in capsys.readouterr().err
    path = config(folder)
    text = path.read_text().replace("  strip_b:\n", "  strip_b:\n    calibrate: [relacks]\n")
    path.write_text(text)
    with pytest.raises(SystemExit):
        main(("check", "strips", "--config", str(path)))
    told = capsys.readouterr()
    assert "strip_b" in told.err and "relacks" in told.err
    assert f"in {folder / 'c' / 'strip'}" in told.out, "the others are still looked at"
