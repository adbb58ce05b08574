"""Mistakes in a user's own model that would end a fit, or never show: `check` says them."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.own_model_page import MODEL, said
from tests.shared.study_folders import replace_in

from deabayes.checks.study import check_names
from deabayes.cli.main import main
from deabayes.studies import load_studies

ANSWER = """            return relaxation_response(
                squared, np.zeros_like(per_square), per_square[:, None], lag
            )
"""
ANSWERED = ANSWER.replace("return ", "answer = ")
TAU = '"tau", r"\\tau", "s"'
SET = "self.candidate, self.order, self.specimen = candidate, int(candidate[-1]), specimen"
DERIVED = """
    def derived(self, draws):
        from deabayes.systems import Derived

        return {}
"""


ANOTHER_EACH_TIME = (
    'simulate.calls = getattr(simulate, "calls", 0) + 1; '
    "return answer * (1.0 + 0.01 * simulate.calls)"
)
"""As a random one would, but with no chance to be the same."""


def answering(ending: str) -> tuple[str, str]:
    """The change after which the response is what `ending` makes of `answer`."""
    return ANSWER, f"{ANSWERED}            {ending}\n"


def named(name: str) -> list[tuple[str, str]]:
    """The changes after which tau is called otherwise."""
    return [(TAU, TAU.replace('"tau"', f'"{name}"')), ('draws["tau"]', f'draws["{name}"]')]


def deriving(found: str) -> tuple[str, str]:
    """The change after which a model has this derived quantity."""
    return "        return simulate\n", f"        return simulate\n{DERIVED.replace('{}', found)}"


CANDIDATE = "deabayes: study stack, candidates: models/stack.py: "
TRIAL = "deabayes: study stack, lag_1"
RECORD = f"{TRIAL}, creep_1000V: "
MISTAKES: dict[str, tuple[list[tuple[str, str]], str]] = {
    "draw": (named("draw"), f"{CANDIDATE}parameter 'draw': the name is taken"),
    "chain": (named("chain"), f"{CANDIDATE}parameter 'chain': the name is taken"),
    "a channel": (named("voltage"), f"{CANDIDATE}parameter 'voltage': the name is taken"),
    "slash": (named("tau/x"), f"{CANDIDATE}parameter 'tau/x': use only letters"),
    "noise": (named("creep.sigma_white"), f"{CANDIDATE}parameter 'creep.sigma_white': use only"),
    "twice": (
        [('return (modulus, *(lag,) * self.order', "return (modulus, *(lag,) * 2 * self.order")],
        f"{CANDIDATE}parameter 'tau' occurs 2 times",
    ),
    "unit": (
        [(TAU, TAU.replace('"s"', '"ms"'))],
        f"{CANDIDATE}parameter, tau: unit 'ms' is not SI; write 's'",
    ),
    "prior": (
        [("LogUniform(1e-3, 1.0)", "5"), ("LogNormal, LogUniform", "LogNormal")],
        f"{CANDIDATE}parameter 'tau': the prior is 5; give a distribution",
    ),
    "no parameters": (
        [("        return (modulus, *(lag,) * self.order, *uncertain)\n",
          "        if self.order == 0:\n            return (modulus,)\n")],
        f"{CANDIDATE}parameters() of lag_1 gives None; return a tuple of Parameter",
    ),
    "order": (
        [(SET, "self.candidate, self.specimen = candidate, specimen"),
         ("* self.order", "* int(self.candidate[-1])"),
         ("self.order == 0", 'self.candidate == "lag_0"')],
        f"{CANDIDATE}__init__ must set self.order to a whole number; found none",
    ),
    "candidate": (
        [(SET, "self.order, self.specimen = int(candidate[-1]), specimen")],
        f"{CANDIDATE}__init__ must set self.candidate to the candidate's name; found none",
    ),
    "list": ([answering("return answer.tolist()")], f"{RECORD}the response is a list"),
    "nothing": ([answering("pass")], f"{RECORD}the response is a NoneType; return a numpy"),
    "no function": (
        [("        return simulate\n", "        return simulate if self.order == 0 else None\n")],
        f"{RECORD}simulator gives None; return a function of draws",
    ),
    "complex": (
        [answering("return answer + 0j")],
        f"{RECORD}the response has numbers of type complex128; return real numbers",
    ),
    "first draw for all": (
        [('draws["tau"][:, None]', 'draws["tau"][:1, None]')],
        f"{RECORD}the response to a draw depends on the other draws",
    ),
    "random": (
        [answering(ANOTHER_EACH_TIME)],
        f"{RECORD}the same draws give another response when repeated",
    ),
    "changed draws": (
        [answering('draws["tau"][:] = 1.0; return answer')],
        f"{RECORD}the model changes the draws (tau); change a copy instead",
    ),
    "ends Python": (
        [answering("import sys; sys.exit(3)")],
        "deabayes: models/stack.py, line 57: SystemExit: 3; correct the model there",
    ),
    "derived number": ([deriving('{"k": 3}')], "deabayes: study stack, lag_1: derived 'k' is 3"),
    "derived list": ([deriving("[]")], "deabayes: study stack, lag_1: derived gives []"),
    "derived values": (
        [deriving('{"k": Derived("k", "Pa", "", 1.0)}')],
        "deabayes: study stack, lag_1: derived 'k' has values () of type float64; return (3,)",
    ),
    "derived unit": (
        [deriving('{"k": Derived("k", "MPa", "", draws["Y"])}')],
        "deabayes: study stack, lag_1: derived, k: unit 'MPa' is not SI; write 'Pa'",
    ),
    "derived name": (
        [deriving('{"Y": Derived("k", "Pa", "", draws["Y"])}')],
        "deabayes: study stack, lag_1: derived 'Y': the name is taken",
    ),
}  # fmt: skip


@pytest.fixture
def only_lag_1(place: Path) -> Path:
    replace_in(Path("config.yaml"), "[lag_0, lag_1]", "[lag_1]")
    return place


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence(
    only_lag_1: Path, capsys: pytest.CaptureFixture[str], mistake: str
) -> None:
    changes, expected = MISTAKES[mistake]
    for change in changes:
        replace_in(MODEL, *change)
    told = said(capsys, "check", "stack")
    assert told.startswith(expected), told
    assert told.count("\n") == 1, told


def test_one_mistake_of_every_record_is_said_once(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replace_in(Path("data/stack/experiments.csv"), "validate", "calibrate")
    replace_in(MODEL, *answering("return answer + 0j"))
    assert said(capsys, "check", "stack").count("\n") == 1


def test_the_workflow_says_it_before_its_first_job(only_lag_1: Path) -> None:
    (study,) = load_studies(Path("config.yaml"))
    assert check_names(study) == []
    for change in named("draw"):
        replace_in(MODEL, *change)
    (study,) = load_studies(Path("config.yaml"))
    (fault,) = check_names(study)
    assert "parameter 'draw': the name is taken" in fault
    replace_in(MODEL, "    def parameters(self):\n", "    def parameters(self):\n        1 / 0\n")
    (study,) = load_studies(Path("config.yaml"))
    (fault,) = check_names(study)
    assert "models/stack.py, line 37: ZeroDivisionError" in fault


def test_what_the_package_cannot_do_with_a_call_is_said_of_the_call(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replace_in(MODEL, "LogNormal(1e6, 1.0)", "LogNormal(-1e6, 1.0)")
    told = said(capsys, "check", "stack")
    assert "models/stack.py, line 37: deabayes.prior.distributions raises" in told
    assert "correct the arguments of this call" in told and told.count("\n") == 1


def test_what_fails_in_the_package_is_not_the_models_fault(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As numba does where it can write its cache nowhere."""
    import deabayes.systems.base as module

    source = "def check_channels(*_):\n    raise RuntimeError('no locator')\n"
    namespace: dict[str, object] = {}
    exec(compile(source, module.__file__, "exec"), namespace)
    monkeypatch.setattr(module.System, "check_channels", namespace["check_channels"])
    with pytest.raises(RuntimeError, match="no locator"):
        main(("check", "stack"))


def test_one_mistake_of_every_candidate_is_said_once(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replace_in(MODEL, '"Y", "Y", "Pa"', '"Y", "Y", "MPa"')
    told = said(capsys, "check", "stack")
    assert "parameter, Y: unit 'MPa' is not SI; write 'Pa'" in told and told.count("\n") == 1
