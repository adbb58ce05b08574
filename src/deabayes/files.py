"""Write files so that a killed job leaves no half-written file."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk; they name no file."""


def write_atomically(write: Callable[[Path], object], path: Path) -> None:
    """Call `write(temporary path)`, then move the finished file to `path`.

    The temporary file lies in the same folder, which is made if needed; another
    process that writes the same file has a temporary file of its own.

    Raises
    ------
    IsADirectoryError
        There is a folder of that name.
    OSError
        It cannot be written there; the file named is `path`.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, name a file", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())  # after a power cut the name must not point to an empty file
        temporary.replace(path)
    except OSError as error:
        unnamed = error.filename is None and error.errno in NO_ROOM
        if not unnamed and str(temporary) not in f"{error.filename} {error}":
            raise
        raise OSError(error.errno, _reason(error), str(path)) from error
    finally:
        with suppress(OSError):  # an error here must not hide the first one
            temporary.unlink(missing_ok=True)


def _reason(error: OSError) -> str:
    """The system's reason and a remedy; errors of HDF5 have a number but no short text."""
    told = os.strerror(error.errno) if error.errno else str(error)
    remedy = "make room" if error.errno in NO_ROOM else "name another place"
    return f"cannot be written ({told}); {remedy}"


def write_netcdf_atomically(content: xr.Dataset | xr.DataTree, path: Path) -> None:
    """Write as netCDF, whole or not at all; raises as `write_atomically`.

    The file is built in memory: on a full disk HDF5 would end Python.
    """
    whole = io.BytesIO()
    content.to_netcdf(whole, engine="h5netcdf")
    write_atomically(lambda place: place.write_bytes(whole.getbuffer()), path)


def write_text_atomically(text: str, path: Path) -> None:
    """Write UTF-8 text with `\\n` line ends, whole or not at all."""
    write_atomically(lambda place: place.write_text(text, encoding="utf-8", newline="\n"), path)
