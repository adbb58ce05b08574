"""A rule's command is run again after an edit of any module that it computes with."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import pytest
from tests.unit.own_model_page import write_page
from tests.workflow.snakemake_runs import ROOT, snakemake

SOURCE = ROOT / "src"
FILES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts): path
    for path in (SOURCE / "deabayes").rglob("*.py")
    if path.name != "__init__.py"
}
STARTS = {
    "prepare": ("preparation.prepare", "preparation.prepared", "reading.folder"),
    "fit": (
        "sampling.engine",
        "posterior",
        "posteriors.inheritance",
        "posteriors.file",
        "checks.prior_scale",
    ),
    "score": ("comparison.scoring", "comparison.left_out"),
    "predict": ("fitted", "prediction.bands", "prediction.errors_table"),
    "compare": ("comparison.ranking",),
    "further_experiments": ("further.table", "further.planned"),
}
"""What the pipeline's function for a rule calls."""
PLUMBING = {
    "carried_unit",
    "compiled",
    "faults",
    "files",
    "given_drive",
    "given_values",
    "posteriors.storage",
    "quantities",
    "registry",
    "study",
}
"""Modules that no number of these rules depends on; settings are parameters of the rules."""


@cache
def imported(name: str) -> frozenset[str]:
    """The package's modules that one imports when it runs."""
    found: set[str] = set()
    todo: list[ast.AST] = [ast.parse(FILES[name].read_text("utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{each.name}" for each in node.names)}
        elif isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        todo += ast.iter_child_nodes(node)
    return frozenset(found & set(FILES))


def reached(starts: Iterable[str]) -> set[str]:
    """The modules that these import, and those that they import in turn."""
    found: set[str] = set()
    todo = [name for start in starts if (name := f"deabayes.{start}") in FILES]
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += imported(name)
    return {name.removeprefix("deabayes.") for name in found}


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, set[str]]:
    """By rule, the modules whose edit runs it again: its own and those of the jobs before."""
    place = write_page(tmp_path_factory.mktemp("stack"))
    run = snakemake(place, "--cores", "1", "--dry-run", "--forceall")
    assert run.returncode == 0, run.stderr
    job = re.compile(r"^(?:local)?rule (\w+):\n    input: (.*)\n    output: (.*)$", re.MULTILINE)
    inputs: dict[str, set[str]] = {}
    made_by: dict[str, str] = {}
    for rule, needed, made in job.findall(run.stdout):
        inputs.setdefault(rule, set()).update(needed.split(", "))
        made_by |= dict.fromkeys(re.sub(r" \(.*?\)", "", made).split(", "), rule)
    return {rule: _modules(rule, inputs, made_by, place) for rule in inputs}


def _modules(
    rule: str, inputs: Mapping[str, set[str]], made_by: Mapping[str, str], place: Path
) -> set[str]:
    names, seen, todo = set(), set(), [rule]
    while todo:
        each = todo.pop()
        if each in seen:
            continue
        seen.add(each)
        todo += [made_by[path] for path in inputs.get(each, ()) if path in made_by]
        for path in inputs.get(each, ()):
            whole = Path(os.path.normpath(place / path))
            if whole.is_relative_to(SOURCE):
                names.add(".".join(whole.relative_to(SOURCE / "deabayes").with_suffix("").parts))
    return names


@pytest.mark.parametrize("rule", STARTS)
def test_every_module_that_a_rule_computes_with_is_watched(
    rule: str, watched: Mapping[str, set[str]]
) -> None:
    assert watched[rule], "no module is watched"
    assert reached(STARTS[rule]) - watched[rule] - PLUMBING == set()
