"""The source files that a stage of the workflow runs: a result follows from them too."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
LOADS_BY_NAME = "import_module"
"""Function by which a package's registry imports the modules beside it."""


def sources_of(*modules: str) -> list[Path]:
    """The files of modules of this package and of all that they import, directly or not.

    A package with a registry counts with all modules in its folder. Imports for type checkers do
    not count.

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


def _imported_by(path: Path) -> Iterator[Path]:
    tree = ast.parse(path.read_text(encoding="utf-8") if path.suffix == ".py" else "")
    for node in _executed(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == LOADS_BY_NAME and path.name == "__init__.py":
                yield from path.parent.rglob("*.py")
            if node.func.id == "files" and isinstance(node.args[0], ast.Constant):
                yield from _data_files(str(node.args[0].value))
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("deabayes"):
            continue
        package = str(node.module).partition(".")[2]
        for alias in node.names:
            file = _file(f"{package}.{alias.name}") or _file(package)
            if file is not None:
                yield file


def _data_files(package: str) -> Iterator[Path]:
    """What `importlib.resources.files` finds in a package besides modules."""
    folder = PACKAGE.joinpath(*package.split(".")[1:])
    yield from (path for path in folder.iterdir() if path.is_file() and path.suffix != ".py")


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Every node but those of blocks for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from _executed(node)


def _file(module: str) -> Path | None:
    """The file of a module of the package, None if there is none; its own `__init__` is none."""
    path = PACKAGE.joinpath(*module.split(".")) if module.strip(".") else None
    if path is None:
        return None
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((each for each in candidates if each.is_file()), None)
