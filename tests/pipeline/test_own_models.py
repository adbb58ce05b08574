"""Systems of a user's own: loading their files, and every mistake in them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.shared.own_model_page import MODEL, said
from tests.shared.study_folders import replace_in

import deabayes
from deabayes.cli.main import main
from deabayes.faults import Faults, UserError
from deabayes.own_models import loading
from deabayes.own_models.loading import load_models, recorded, restore
from deabayes.pipeline.fit import chain_folder
from deabayes.studies import load_studies, load_study, write_study
from deabayes.systems import OWN, system_class

OTHER = """
  strip:
    specimen: data/strip
    candidates: [kv_gm_1]
"""


def test_the_pages_model_is_its_closed_form(place: Path) -> None:
    assert load_models(MODEL) == {"stack": MODEL}
    time = np.linspace(0.0, 0.2, 41)
    draws = {"Y": np.array([1e6, 2e6]), "tau": np.array([0.02, 0.05])}
    found = deabayes.simulate(
        "stack", "lag_1", draws, "data/stack", time, voltage=np.full(time.size, 1000.0)
    )
    pressure = 8.8541878188e-12 * 3.0 * (1000.0 / 50e-6) ** 2
    at_rest = 0.01 * pressure / draws["Y"][:, None]
    expected = at_rest * (1.0 - np.exp(-time / draws["tau"][:, None]))
    np.testing.assert_allclose(found.displacement, expected, rtol=1e-9, atol=1e-15)
    names = [each.name for each in system_class("stack")("lag_0", _specimen()).parameters()]
    assert names == ["Y", "thickness"]


def _specimen() -> object:
    from deabayes.records.specimen import read_specimen

    return read_specimen(Path("data/stack"))


MISTAKES: dict[str, tuple[tuple[str, str], list[str]]] = {
    "syntax": (("class Stack(System):", "class Stack(System:"), ["line 16: SyntaxError"]),
    "import": (
        ("import numpy as np", "import numpie as np"),
        ["line 3: ModuleNotFoundError: No module named 'numpie'"],
    ),
    "name error": (("class Stack(System)", "class Stack(Sytem)"), ["line 16", "'Sytem'"]),
    "ends Python": (("import numpy as np", "raise SystemExit(3)"), ["line 3: SystemExit: 3"]),
    "no system": (("class Stack(System)", "class Stack"), ["defines no System", "own-model.md"]),
    "taken": (('name = "stack"', 'name = "tubular"'), ["class Stack", "'tubular'", "shipped"]),
    "no name": (('    name = "stack"\n', ""), ["class Stack: name must be", "found none"]),
    "abstract": (("def simulator(", "def simulater("), ["class Stack: lacks simulator"]),
    "no protocols": (("    protocols =", "    protokols ="), ["protocols must be a tuple", "none"]),
    "one protocol": (
        ('protocols = ("creep", "step", "sine")', 'protocols = ("creep")'),
        ["protocols must be a tuple", "'creep'"],
    ),
    "protocol": (('"step"', '"stp"'), ["unknown protocol 'stp'", "did you mean 'step'?"]),
    "no responses": (
        ("    responses =", "    answers ="),
        ["responses must map", "found none"],
    ),
    "not SI": (('{"voltage": "V"}', '{"voltage": "kV"}'), ["'kV' is not SI; write 'V'"]),
    "no unit": (('{"voltage": "V"}', '{"voltage": "Vlt"}'), ["excitations, voltage", "Vlt"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_with_file_and_key(
    place: Path, capsys: pytest.CaptureFixture[str], mistake: str
) -> None:
    change, words = MISTAKES[mistake]
    replace_in(MODEL, *change)
    told = said(capsys, "check", "stack")
    assert told.startswith("deabayes: config.yaml, models: models/stack.py"), told
    assert told.count("\n") == 1, told
    for word in words:
        assert word in told
    assert not OWN


def test_the_model_is_tried_on_the_records(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prior = "{sigma_ou: {distribution: lognormal, median: 0.01, sigma: 1}}"
    replace_in(Path("config.yaml"), "preparation:", f"priors: {prior}\n    preparation:")
    main(("check", "stack"))
    assert "no finite response" not in capsys.readouterr().out
    replace_in(MODEL, '/ draws["Y"]', '/ (0.0 * draws["Y"])')
    main(("check", "stack"))
    warned = "study stack, lag_0, creep_1000V: the model has no finite response at the median"
    assert warned in capsys.readouterr().out
    replace_in(MODEL, "per_square[:, None] * squared.input", "squared.input")
    told = said(capsys, "check", "stack")
    assert "study stack, lag_0, creep_1000V" in told
    assert "shape (250,); return (3, 250)" in told and told.count("\n") == 1


def test_a_missing_file(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    MODEL.unlink()
    told = said(capsys, "check", "data/stack")
    assert told.startswith("deabayes: config.yaml, models: models/stack.py: there is no such file")
    replace_in(Path("config.yaml"), "models/stack.py", "models")
    assert "models: models: Is a directory" in said(capsys, "check", "stack")


def test_models_is_a_list(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace_in(Path("config.yaml"), "[models/stack.py]", "models/stack.py")
    for what in ("stack", "data/stack"):
        told = said(capsys, "check", what)
        assert told.startswith("deabayes: config.yaml, models: expected a list"), told


def test_an_unnamed_file_is_asked_for(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace_in(Path("config.yaml"), "[models/stack.py]", "[]")
    told = said(capsys, "check", "data/stack")
    assert "unknown system 'stack'" in told and "under `models` in config.yaml" in told


def test_one_system_in_two_files(place: Path) -> None:
    Path("second.py").write_bytes(MODEL.read_bytes())
    with pytest.raises(Faults, match=r"second\.py: system .stack. is also defined in models"):
        load_models(MODEL, "second.py")
    assert load_models(MODEL, MODEL) == {"stack": MODEL}


def test_a_base_class_without_a_name_is_no_system(place: Path) -> None:
    replace_in(
        MODEL, "class Stack(System):", "class Base(System):\n    pass\n\n\nclass Stack(Base):"
    )
    assert load_models(MODEL) == {"stack": MODEL}


def test_an_edited_file_replaces_what_it_defined(place: Path) -> None:
    load_models(MODEL)
    first = system_class("stack")
    load_models(MODEL)
    assert system_class("stack") is first
    replace_in(MODEL, '"wide"', '"vast"')
    load_models(MODEL)
    assert system_class("stack") is not first


def test_a_study_names_its_own_systems_file_only(place: Path, tmp_path: Path) -> None:
    folder = tmp_path / "data" / "strip"
    folder.mkdir()
    (folder / "specimen.yaml").write_text("system: tensile_strip\n")
    text = Path("config.yaml").read_text()
    Path("config.yaml").write_text(text + OTHER)
    stack, strip = load_studies(Path("config.yaml"))
    assert (stack.model, strip.model) == (MODEL, None)
    nested = tmp_path / "elsewhere"
    nested.mkdir()
    (nested / "config.yaml").write_text(
        text.replace("models/", "../models/").replace("data/", "../data/")
    )
    (stack,) = load_studies(nested / "config.yaml")
    assert stack.model == tmp_path / MODEL


def test_a_study_file_loads_its_model(place: Path) -> None:
    (study,) = load_studies(Path("config.yaml"))
    write_study(study, Path("results/stack/study.yaml"))
    OWN.clear()
    assert load_study(Path("results/stack/study.yaml")) == study
    assert "stack" in OWN
    MODEL.unlink()
    with pytest.raises(Faults, match=r"study\.yaml, model: models/stack\.py: there is no such"):
        load_study(Path("results/stack/study.yaml"))


def test_checkpoints_of_another_text_are_not_resumed(place: Path) -> None:
    (study,) = load_studies(Path("config.yaml"))
    folders = [chain_folder(study, "lag_1", Path("prepared"), Path("results"))]
    replace_in(MODEL, '"wide"', '"vast"')
    folders.append(chain_folder(study, "lag_1", Path("prepared"), Path("results")))
    assert folders[0] != folders[1]


def _attributes() -> dict[str, str]:
    load_models(MODEL)
    attributes = {"system": "stack", "study_name": "s", "candidate": "lag_1", **recorded("stack")}
    OWN.clear(), loading._FILES.clear()
    return attributes


def test_a_posterior_is_used_with_the_text_it_was_fitted_with(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attributes = _attributes()
    restore(attributes)
    fitted = system_class("stack")
    replace_in(MODEL, '"wide"', '"vast"')
    restore(attributes)
    assert system_class("stack") is fitted
    load_models(MODEL)
    with pytest.raises(
        UserError, match=r"s, lag_1: fitted with models/stack\.py, which has changed"
    ):
        restore(attributes)
    restore({"system": "tubular"})


def test_a_posterior_elsewhere_says_which_file_is_missing(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attributes = _attributes()
    elsewhere = place / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    wanted = (
        rf"models/stack\.py, which does not exist in {re.escape(str(elsewhere))}; .*load_models"
    )
    with pytest.raises(UserError, match=wanted):
        restore(attributes)
    Path("copy.py").write_bytes((place / MODEL).read_bytes())
    load_models("copy.py")
    restore(attributes)
    assert system_class("stack").name == "stack"


def test_what_fails_in_a_model_is_said_with_its_line(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replace_in(MODEL, "self.order == 0", "self.ordr == 0")
    arguments = ("--excitation", "data/stack/records/creep_1000V.csv", "--set", "Y=1e6")
    told = said(
        capsys, "simulate", "stack", "lag_0", "--specimen", "data/stack", *arguments, "-o", "x.csv"
    )
    assert told.startswith("deabayes: models/stack.py, line 5"), told
    assert "AttributeError" in told and "'ordr'" in told and told.count("\n") == 1


def test_a_fault_elsewhere_stays_a_traceback(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("ours")

    load_models(MODEL)
    monkeypatch.setattr("deabayes.cli.records.check_by_name", broken)
    with pytest.raises(RuntimeError, match="ours"):
        main(("check", "stack"))


def test_commands_know_the_systems_of_the_config(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(("check", "data/stack"))
    assert "0 faults" in capsys.readouterr().out
    OWN.clear()
    Path("config.yaml").write_text("models: [models/stack.py]\n")  # its studies are still to come
    main(("new", "mine", "--system", "stack"))
    assert "candidates: [lag_0, lag_1]" in capsys.readouterr().out
    assert "height: {value: ..., unit: 'mm'" in Path("data/mine/specimen.yaml").read_text()
    OWN.clear()
    record = "data/stack/records/creep_1000V.csv"
    main(("simulate", "stack", "lag_0", "--specimen", "data/stack", "--excitation", record,
          "--set", "Y=1e6", "-o", "x.csv"))  # fmt: skip
    assert Path("x.csv").read_text().startswith("time [s],displacement [m],voltage [V]")
