"""YAML files as a user writes them: duplicate keys are mistakes, `1e-3` is a number."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from deabayes.faults import UserError

FLOAT = re.compile(
    r"^[-+]?(?:\d[\d_]*\.[\d_]*(?:[eE][-+]?\d+)?|\d[\d_]*[eE][-+]?\d+|\.\d+(?:[eE][-+]?\d+)?"
    r"|\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$|^-\.(?:inf|Inf|INF)$"
)


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises
    ------
    UserError : missing or empty file, not UTF-8, bad syntax, a key given twice.
    """
    import yaml

    path = Path(path)
    if path.is_dir():
        within = path / "config.yaml"
        raise UserError(f"{path}: is a folder; name a file{f', {within}' * within.is_file()}")
    if not path.is_file():
        remedy = "correct the path, or write it (docs/reference/configuration.md)"
        if path.name == "specimen.yaml":
            remedy = "`deabayes new` writes one to fill in"
        raise UserError(f"{path}: there is no such file; {remedy}")
    try:
        content = yaml.load(path.read_text(encoding="utf-8-sig"), Loader=_loader())
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise UserError(f"{path}: is not UTF-8 (byte 0x{byte:02x}); save it as UTF-8") from None
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise UserError(f"{path}{line}: {error.problem}; correct the YAML there") from None
    except yaml.YAMLError as error:
        raise UserError(f"{path}: is not YAML ({error}); correct it") from None
    if not isinstance(content, dict):
        found = "nothing" if content is None else repr(content)[:60]
        raise UserError(f"{path}: expected `key: value` lines, found {found}")
    return content


def scalar(text: str) -> str:
    """The text as it is to be written in a YAML file, in quotes where it needs them."""
    import yaml

    try:
        plain = yaml.load(text, Loader=_loader()) == text
    except yaml.YAMLError:
        plain = False
    return text if plain else "'" + text.replace("'", "''") + "'"


@cache
def _loader() -> type[Any]:
    import yaml

    class Loader(yaml.SafeLoader):
        """SafeLoader with YAML 1.2 floats and without silently overwritten keys."""

        def compose_mapping_node(self, anchor: Any) -> Any:
            # As written: merge keys (`<<: *other`) give what they bring in once more later.
            node = super().compose_mapping_node(anchor)
            seen: set[tuple[str, str]] = set()
            for key, _ in node.value:
                if (key.tag, str(key.value)) in seen:
                    raise yaml.composer.ComposerError(
                        None, None, f"key {key.value!r} is given twice", key.start_mark
                    )
                seen.add((key.tag, str(key.value)))
            return node

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789."))
    return Loader
