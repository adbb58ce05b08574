"""Source files that a stage of the workflow runs; its results depend on them too."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
IMPORT = re.compile(r"^ *from deabayes\.?([\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
FOR_TYPE_CHECKERS = re.compile(r"^if TYPE_CHECKING:\n(?: +.*\n|\n)+", re.MULTILINE)
DATA = re.compile(r'\bfiles\("deabayes\.([\w.]+)"\)')
"""Where `importlib.resources.files` names a package of data files."""
IMPORTS_BY_NAME = "import_module("
"""What a package's registry imports its modules with."""


def sources_of(*modules: str) -> list[Path]:
    """Return the files of modules of this package and of all that they import, directly or not.

    A package with a registry counts with all modules in its folder. Imports for type checkers do
    not count. Data files that a module names with `importlib.resources.files` do.

    Parameters
    ----------
    modules : names within the package, such as ``pipeline.fit``.

    Raises
    ------
    FileNotFoundError
        A module does not exist.
    """
    found: set[Path] = set()
    left = [_file(name) for name in modules]
    while left:
        path = left.pop()
        if path is None:
            raise FileNotFoundError(f"no module of {', '.join(modules)}")
        if path not in found:
            found.add(path)
            left += _imported_by(path)
    return sorted(found)


@cache
def digest_of(*modules: str) -> str:
    """Return a checksum of the text of `sources_of` modules: an edit of any of them changes it."""
    digest = hashlib.sha256()
    for path in sources_of(*modules):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(PACKAGE).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


@cache
def _imported_by(path: Path) -> tuple[Path, ...]:
    """Return the files that one file imports; parsing its syntax would be ten times as slow."""
    if path.suffix != ".py":
        return ()
    text = FOR_TYPE_CHECKERS.sub("", path.read_text(encoding="utf-8"))
    found = list(_named(text))
    if path.name == "__init__.py" and IMPORTS_BY_NAME in text:
        found += path.parent.rglob("*.py")
    for package in DATA.findall(text):
        folder = PACKAGE.joinpath(*package.split("."))
        found += (each for each in folder.iterdir() if each.is_file() and each.suffix != ".py")
    return tuple(found)


def _named(text: str) -> Iterator[Path]:
    for package, names in IMPORT.findall(text):
        for name in names.strip("()").split(","):
            file = _file(f"{package}.{name.split(' as ')[0].strip()}") or _file(package)
            if file is not None:
                yield file


@cache
def _file(module: str) -> Path | None:
    """Return the file of a module, or None if there is none. The package itself has none."""
    if not module.strip("."):
        return None
    path = PACKAGE.joinpath(*module.split("."))
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((each for each in candidates if each.is_file()), None)
