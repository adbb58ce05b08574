"""Where compiled code is kept when numba finds no place for it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numba
import pytest
from numba.core import caching

import deabayes
from deabayes import compiled
from deabayes.faults import UserError


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Temporary files are the one thing that can be written; where they are."""
    for name in ("InTreeCacheLocator", "UserWideCacheLocator"):
        locator = getattr(caching, name, None) or getattr(caching, f"_{name}")
        monkeypatch.setattr(locator, "from_function", lambda *_: None)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def twice(value: float) -> float:
    return 2.0 * value


def test_code_is_kept_among_temporary_files(nowhere: Path) -> None:
    with pytest.raises(RuntimeError, match="no locator available"):
        numba.njit(cache=True)(twice)
    assert compiled.njit(cache=True)(twice)(1.5) == 3.0
    (folder,) = nowhere.iterdir()
    assert folder.stat().st_mode & 0o077 == 0
    assert list(folder.rglob("*.nbc"))
    assert compiled.temporary_cache() == str(folder)


def test_a_folder_that_others_can_write_is_not_taken(nowhere: Path) -> None:
    first = Path(compiled.temporary_cache())
    first.chmod(0o777)
    assert compiled.temporary_cache() != str(first)


def test_no_place_at_all_is_said(nowhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(nowhere / "none"))
    with pytest.raises(UserError, match="set NUMBA_CACHE_DIR"):
        compiled.njit(cache=True)(twice)


def test_every_kernel_is_compiled_so() -> None:
    sources = Path(deabayes.__file__).parent.rglob("*.py")
    assert not [path for path in sources if "from numba import" in path.read_text("utf-8")]
