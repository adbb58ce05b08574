"""Find and load the files that define a user's own systems."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from deabayes.faults import Faults, UserError
from deabayes.own_models.checks import fault_of, said, system_faults
from deabayes.records.schema import read_yaml, violations
from deabayes.records.specimen import system_named
from deabayes.systems import OWN, REGISTRY, System

REMEDY = "docs/how-to/own-model.md has an example"


@dataclass(frozen=True)
class ModelFile:
    """A model file with its hash at the time of loading."""

    path: Path
    sha256: str


_FILES: dict[str, ModelFile] = {}


def load_models(*files: str | Path) -> dict[str, Path]:
    """Register the systems that Python files define, by their names.

    A file must be self-contained: it may import installed packages, but no file beside it.
    Loading a file again after an edit replaces its earlier systems.

    Parameters
    ----------
    *files
        Paths relative to the working directory.

    Returns
    -------
    dict
        System -> the file that defines it.

    Raises
    ------
    Faults
        Every file that is missing, cannot be run or defines no usable `System`, and
        every name that two systems share.
    """
    found: dict[str, type[System]] = {}
    read: dict[str, ModelFile] = {}
    faults: list[str] = []
    for path in dict.fromkeys(Path(file) for file in files):
        try:
            source = _text_of(path)
            systems = _systems_in(path, source)
        except UserError as error:
            faults += str(error).splitlines()
            continue
        for kind in systems:
            if kind.name in read:
                faults.append(
                    f"{path}: system {kind.name!r} is also defined in {read[kind.name].path}; "
                    "rename one of them"
                )
            found[kind.name] = kind
            read[kind.name] = ModelFile(path, hashlib.sha256(source).hexdigest())
    if faults:
        raise Faults(faults)
    OWN.update(found)
    _FILES.update(read)
    return {name: file.path for name, file in read.items()}


def recorded(system: str) -> dict[str, str]:
    """Return the attributes that a posterior stores about its model file; empty if shipped."""
    file = _FILES.get(system)
    return {} if file is None else {"model_file": str(file.path), "model_sha256": file.sha256}


def restore(attributes: Mapping[str, str]) -> None:
    """Load the model file that a posterior was fitted with, if it has one.

    Raises
    ------
    UserError
        The file is missing or has changed, and no unchanged copy has been loaded.
    """
    system, wanted = attributes["system"], attributes.get("model_sha256")
    if wanted is None or _is_loaded(system, wanted):
        return
    path = Path(attributes["model_file"])
    fitted = f"{attributes['study_name']}, {attributes['candidate']}: fitted with {path}"
    if not path.is_file():
        raise UserError(
            f"{fitted}, which does not exist in {Path.cwd()}; work in the folder of the fit, "
            "or load a copy first: deabayes.load_models(FILE)"
        )
    if hashlib.sha256(_text_of(path)).hexdigest() != wanted:
        raise UserError(
            f"{fitted}, which has changed since (SHA-256 was {wanted[:12]}); fit again, or "
            "restore the file"
        )
    load_models(path)


@contextmanager
def said_of_the_model() -> Iterator[None]:
    """Turn errors that arise in a loaded model's file into `UserError`."""
    try:
        yield
    except UserError:
        raise
    except (Exception, SystemExit) as error:
        fault = fault_in_a_model(error)
        if fault is None:
            raise
        raise UserError(fault) from error


def fault_in_a_model(error: BaseException) -> str | None:
    """Say where in a loaded model's file an error arose; None if it arose elsewhere."""
    faults = (fault_of(error, path) for path in {file.path for file in _FILES.values()})
    return next((fault for fault in faults if fault is not None), None)


def _is_loaded(system: str, sha256: str) -> bool:
    return system in _FILES and _FILES[system].sha256 == sha256


def _text_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = "there is no such file" if isinstance(error, FileNotFoundError) else error.strerror
        raise UserError(
            f"{path}: {reason}; `models` names Python files that define a System"
        ) from None


@lru_cache(maxsize=64)
def _systems_in(path: Path, source: bytes) -> tuple[type[System], ...]:
    """Return the systems that a file with this text defines, after checking them."""
    module = _run(path, source)
    classes = dict.fromkeys(each for each in vars(module).values() if isinstance(each, type))
    mine = [c for c in classes if issubclass(c, System) and c.__module__ == module.__name__]
    offered = [
        kind
        for kind in mine
        if hasattr(kind, "name") or not any(kind in other.__bases__ for other in mine)
    ]
    if not offered:
        raise UserError(
            f"{path}: defines no System; derive a class from deabayes.systems.System ({REMEDY})"
        )
    faults = [f"{path}, {fault}" for kind in offered for fault in system_faults(kind)]
    if faults:
        raise Faults(faults)
    return tuple(offered)


def _run(path: Path, source: bytes) -> ModuleType:
    """Run a file from its text and return the module; Python's own cache may be outdated."""
    digest = hashlib.sha256(str(path.resolve()).encode() + source).hexdigest()
    module = ModuleType(f"deabayes_own_model_{digest[:16]}")
    module.__file__ = str(path.resolve())
    sys.modules[module.__name__] = module  # dataclasses look up their annotations there
    try:
        exec(_compiled(path, source, module.__file__), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[module.__name__]
        fault = fault_of(error, path)
        if fault is None:
            raise
        raise UserError(fault) from error
    return module


def _compiled(path: Path, source: bytes, name: str) -> CodeType:
    try:
        return compile(source, name, "exec")
    except (SyntaxError, ValueError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise UserError(f"{path}{line}: {said(error)}; correct the model there") from error


def load_named(content: Mapping[str, Any], bases: Sequence[Path], where: str) -> dict[str, Path]:
    """Load the systems whose files a config names, once for all studies.

    Parameters
    ----------
    content : content of the config, valid by its schema.
    bases : folders that its paths may be relative to.
    where : the config, for messages.

    Returns
    -------
    dict
        System -> its file, relative to the working directory.

    Raises
    ------
    Faults : every fault of every file.
    """
    files = list(content.get("models") or ())
    key = "models" if files else "model"
    files += [study["model"] for study in content["studies"].values() if study.get("model")]
    try:
        return load_models(*(seen(Path(file), bases) for file in files))
    except UserError as error:
        faults = str(error).splitlines()
        raise Faults(f"{where}, {key}: {fault}" for fault in faults) from None


def load_for(system: str, config: Path) -> None:
    """Load the files under `models` of a config, unless the system is a shipped one.

    Without a config file, nothing is loaded. Other parts of the config are not checked, because
    its studies may not exist yet.

    Raises
    ------
    Faults : as in `load_named`, or `models` is no list of files.
    """
    if not system or system in REGISTRY or not Path(config).is_file():
        return
    content = read_yaml(Path(config))
    faults = violations(content, "config", str(config))
    faults = [fault for fault in faults if fault.startswith(f"{config}, models")]
    if faults:
        raise Faults(faults)
    load_named({**content, "studies": {}}, [Path(config).parent], str(config))


def model_of(specimen: Path, own: Mapping[str, Path]) -> Path | None:
    """Return the file that defines the system of a study folder; None if the system is shipped."""
    return own.get(system_named(specimen)) if own else None


def seen(file: Path, bases: Sequence[Path]) -> Path:
    """Return the path of a config's file, relative to the working directory."""
    base = next((base for base in bases if (base / file).is_file()), bases[0])
    return Path(os.path.normpath(base / file))
