"""What every unit test runs under."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from deabayes.own_models import loading
from deabayes.papers.membrane import influence
from deabayes.systems import OWN
from tests.shared.own_model_page import write_page


@pytest.fixture(scope="session", autouse=True)
def few_model_runs():
    """The analysis `influence` on few draws: its size is for a paper's intervals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(influence, "GROUPS", 128)
        patch.setattr(influence, "DRAWS", 200)
        yield


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's files with their records, not to be changed."""
    return write_page(tmp_path_factory.mktemp("page"))


@pytest.fixture
def place(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the page's files as the working directory; no own system is known before."""
    for path in page.rglob("*.*"):
        (tmp_path / path.relative_to(page)).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path.relative_to(page)).write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    known, files = dict(OWN), dict(loading._FILES)
    OWN.clear(), loading._FILES.clear()
    yield tmp_path
    for mapping, before in ((OWN, known), (loading._FILES, files)):
        mapping.clear(), mapping.update(before)
