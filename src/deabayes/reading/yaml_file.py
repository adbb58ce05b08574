"""YAML files as a user writes them: duplicate keys are mistakes, `1e-3` is a number."""

from __future__ import annotations

import re
from collections.abc import Hashable
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
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; `deabayes new` writes one to fill in")
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


@cache
def _loader() -> type[Any]:
    import yaml

    class Loader(yaml.SafeLoader):
        """SafeLoader with YAML 1.2 floats and without silently overwritten keys."""

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
            seen: set[Hashable] = set()
            for key_node, _ in node.value:
                key = self.construct_object(key_node, deep=True)
                if isinstance(key, Hashable) and key in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"key {key!r} is given twice", key_node.start_mark
                    )
                seen.add(key)
            return super().construct_mapping(node, deep)

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789."))
    return Loader
