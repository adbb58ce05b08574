"""The source files of a stage: all that it imports when it runs, and nothing above it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from deabayes.pipeline import sources
from deabayes.pipeline.sources import PACKAGE, digest_of, sources_of

LOADED = """
import sys
import {module}
print(*(m.__file__ for n, m in sys.modules.items() if n.startswith("deabayes.") and m.__file__))
"""


def names(*modules: str) -> set[str]:
    return {path.relative_to(PACKAGE).as_posix() for path in sources_of(*modules)}


@pytest.mark.parametrize(
    "module", ["comparison.ranking", "report.contents", "posteriors.inheritance"]
)
def test_what_python_loads_is_among_them(module: str) -> None:
    code = LOADED.format(module=f"deabayes.{module}")
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {path.removeprefix(f"{PACKAGE}/") for path in run.stdout.split()}
    parents = {f"{'/'.join(module.split('.')[:k])}/__init__.py" for k in (1, 2)}
    assert len(loaded) > 5
    missing = {path for path in loaded - names(module) - parents if path.endswith(".py")}
    assert {path for path in missing if not path.endswith("__init__.py")} == set()


def test_a_registry_counts_with_all_that_it_offers() -> None:
    found = names("pipeline.fit")
    assert {"noise/student_t.py", "systems/tubular/system.py", "systems/springs/ogden.py"} <= found
    assert {"sampling/engine.py", "prior/learned.py", "records/preparation/average.py"} <= found


def test_what_is_above_a_fit_does_not_count() -> None:
    rooms = {path.partition("/")[0] for path in names("pipeline.fit")}
    assert not rooms & {"figures", "report", "export", "cli", "papers", "comparison", "population"}


def test_data_files_of_a_package_count() -> None:
    assert {"report/page/index.html", "report/page/style.css", "report/page/page.js"} <= names(
        "report"
    )


def test_a_module_that_is_not_there_is_an_error() -> None:
    with pytest.raises(FileNotFoundError, match=r"no module of pipeline\.fits"):
        sources_of("pipeline.fits")


def test_an_edit_of_a_source_changes_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of one that the stage only imports."""
    monkeypatch.setattr(sources, "PACKAGE", tmp_path)
    (tmp_path / "stage.py").write_text("from deabayes.used import value\n")
    digests = []
    for text in ("value = 1\n", "value = 2\n", "value = 1\n"):
        (tmp_path / "used.py").write_text(text)
        for function in (digest_of, sources._imported_by, sources._file):
            function.cache_clear()
        digests.append(digest_of("stage"))
    assert digests[0] == digests[2] != digests[1]
    for function in (digest_of, sources._imported_by, sources._file):
        function.cache_clear()
