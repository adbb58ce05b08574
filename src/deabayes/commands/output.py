"""What a command may write to: nothing that it reads."""

from __future__ import annotations

import json
from pathlib import Path

from deabayes.faults import UserError

INDEX = "index.json"
"""Lists what is in a folder of figures or of analyses."""
OF_A_STUDY = ("specimen.yaml", "study.yaml", "population.yaml")
"""Files by which a folder is one of records or of results."""


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


def a_folder_of(kind: str, output: Path, key: str, option: str = "-o") -> None:
    """Refuse a folder that holds records or results, or that lists something else than `kind`.

    Parameters
    ----------
    key : what each entry of the folder's index has.

    Raises
    ------
    UserError
    """
    a_folder(output, option)
    for name in OF_A_STUDY:
        if (output / name).is_file():
            raise UserError(f"{option} {output}: holds {name}; name a folder for {kind} alone")
    index = output / INDEX
    if index.is_file() and not _lists(index, key):
        raise UserError(f"{option} {output}: its {INDEX} lists no {kind}; name another folder")


def a_folder_to_replace(kind: str, output: Path, key: str, option: str = "-o") -> None:
    """Refuse the same, and any folder with something in it that is not of `kind`.

    Raises
    ------
    UserError
    """
    a_folder_of(kind, output, key, option)
    held = [*output.iterdir()] if output.is_dir() else []
    if held and not (output / INDEX).is_file():
        raise UserError(
            f"{option} {output}: is replaced as a whole, and holds {min(held).name}; name a new "
            "folder"
        )


def _lists(index: Path, key: str) -> bool:
    try:
        entries = json.loads(index.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(entries, list) and all(isinstance(e, dict) and key in e for e in entries)
