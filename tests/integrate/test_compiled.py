"""Where compiled code is kept when numba finds no place for it."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

import numba
import pytest
from numba.core import caching

import deabayes
from deabayes.faults import UserError
from deabayes.integrate import compiled


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


def locked(folder: Path, name: str = "test") -> bool:
    """Is a process inside `one_at_a_time(name)`, as seen from the lock's file?"""
    with (folder / f"{name}.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def test_one_process_works_and_the_others_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    with compiled.one_at_a_time("test"):
        assert locked(tmp_path / "cache")
    assert not locked(tmp_path / "cache")


def test_one_process_at_a_time_saves_a_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that save different types at once would take the same file."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    kernel = compiled.njit(cache=True)(twice)
    saved: list[bool] = []
    monkeypatch.setattr(
        kernel._cache._cache_file, "save", lambda *_: saved.append(locked(tmp_path, "cache"))
    )
    assert kernel(1.5) == 3.0
    assert saved == [True]


def test_a_package_that_cannot_be_written_is_locked_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with compiled.one_at_a_time("test"):
        assert locked(Path(compiled.temporary_cache()))
    assert not locked(Path(compiled.temporary_cache()))


def test_where_nothing_can_be_locked_the_work_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(os.strerror(37))

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    monkeypatch.setattr(fcntl, "flock", refuse)
    with compiled.one_at_a_time("test"):
        assert (tmp_path / "test.lock").exists()
