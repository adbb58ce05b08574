"""Numba's compiler with a cache folder that works wherever the package is installed."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numba

from deabayes.faults import UserError

try:
    import fcntl
except ImportError:  # the operating system has no file locks
    fcntl = None  # type: ignore[assignment]

literal_unroll = numba.literal_unroll
"""Numba's loop over a tuple of unlike elements."""


def njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` that caches in a temporary folder if no other folder can be written.

    Numba raises an error if it can write neither the package's folder nor the user's, for
    example in a read-only installation without a home folder. Processes write to the cache one
    after the other.
    """

    def compiled(function: Any) -> Any:
        try:
            return _saved_alone(numba.njit(**options)(function))
        except RuntimeError as error:
            if "no locator available" not in str(error):
                raise
            numba.config.CACHE_DIR = temporary_cache()
            return _saved_alone(numba.njit(**options)(function))

    return compiled


def _saved_alone(kernel: Any) -> Any:
    """Let no other process write to numba's cache while a kernel is saved.

    Two processes that save a kernel for different types at the same moment would choose the same
    file (`numba.core.caching.IndexDataCacheFile.save`), and one would later find the other's code.
    """
    save = kernel._cache.save_overload

    def save_alone(*overload: Any) -> None:
        with one_at_a_time("cache"):
            save(*overload)

    kernel._cache.save_overload = save_alone
    return kernel


@contextmanager
def one_at_a_time(name: str) -> Iterator[None]:
    """Admit one process of this machine at a time.

    The lock is a file next to the compiled code. If no file can be locked, the process does not
    wait.
    """
    with ExitStack() as held:
        for folder in (_package_cache, temporary_cache) if fcntl else ():
            try:
                file = held.enter_context((Path(folder()) / f"{name}.lock").open("w"))
                fcntl.flock(file, fcntl.LOCK_EX)
                break
            except (OSError, UserError):
                continue
        yield


def _package_cache() -> Path:
    folder = Path(numba.config.CACHE_DIR or Path(__file__).with_name("__pycache__"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def temporary_cache() -> str:
    """Path of a temporary folder that only this user can write, if possible the same every time.

    Nobody else may write there, because Numba executes the files that it finds.

    Raises
    ------
    UserError : there is no place for temporary files.
    """
    user = os.getuid() if hasattr(os, "getuid") else ""
    try:
        folder = Path(tempfile.gettempdir()) / f"deabayes-numba-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        return str(folder) if _is_own(folder) else tempfile.mkdtemp(prefix="deabayes-numba-")
    except OSError as error:
        raise UserError(
            f"nowhere to keep compiled code ({error}); set NUMBA_CACHE_DIR to a folder that can "
            "be written"
        ) from None


def _is_own(folder: Path) -> bool:
    found = folder.lstat()
    mine = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    shared = os.name == "posix" and found.st_mode & 0o022
    return stat.S_ISDIR(found.st_mode) and mine and not shared
