"""What a command may write to: nothing that it reads."""

from __future__ import annotations

from pathlib import Path

from deabayes.faults import UserError


def keep_inputs(output: Path | None, *inputs: Path | None, option: str = "-o") -> None:
    """Refuse an output that is one of the files or folders that are read, however it is spelt.

    Raises
    ------
    UserError
    """
    if output is None or not output.exists():
        return
    for source in inputs:
        if source is not None and source.exists() and output.samefile(source):
            kind = "folder" if output.is_dir() else "file"
            raise UserError(f"{option} {output}: is the {kind} that is read; name another")


def a_folder(output: Path, option: str = "-o") -> None:
    """Refuse a file where a folder is to be written.

    Raises
    ------
    UserError
    """
    if output.is_file():
        raise UserError(f"{option} {output}: is a file; name a folder")
