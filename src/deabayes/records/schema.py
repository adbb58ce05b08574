"""Read YAML files of users and check them against their schemas."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from deabayes.faults import UserError, nearest

TYPE_NAMES = {
    "object": "a mapping (key: value)",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}
LIMITS = {
    "minimum": ">= {0}",
    "exclusiveMinimum": "> {0}",
    "maximum": "<= {0}",
    "exclusiveMaximum": "< {0}",
    "minItems": "a list of at least {0}",
    "minLength": "not empty",
    "uniqueItems": "a list without repetitions",
    "minProperties": "not empty",
    "maxProperties": "a single key with its settings",
}


@cache
def schema(name: str) -> Mapping[str, Any]:
    """Return the schema `schemas/{name}.schema.yaml`."""
    import yaml

    text = files("deabayes.schemas").joinpath(f"{name}.schema.yaml").read_text(encoding="utf-8")
    loaded: Mapping[str, Any] = yaml.safe_load(text)
    return loaded


def violations(content: Any, name: str, where: str) -> list[str]:
    """List every violation of a schema, in file order, as ``where, key: found; what to do``."""
    import jsonschema

    unquoted = list(_keys_that_are_no_text(content, where))
    if unquoted:
        return unquoted
    validator = jsonschema.Draft202012Validator(schema(name))
    errors = sorted(validator.iter_errors(content), key=lambda error: list(map(str, error.path)))
    return [sentence for error in errors for sentence in _sentences(error, where)]


def _keys_that_are_no_text(content: Any, where: str, key: str = "") -> Iterator[str]:
    """Yield a fault for each key that YAML reads as a number, a date or a truth value."""
    items = enumerate(content) if isinstance(content, list) else ()
    before: tuple[object, object] = ("", "")
    for name, value in content.items() if isinstance(content, Mapping) else items:
        place = f"{where}, {key}" if key else where
        if isinstance(content, Mapping) and _is_fraction(name, value, before[1]):
            yield (
                f"{place}: the comma after `{before[0]}: {before[1]}` ends the number; write a "
                f"decimal point, as in {before[1]}.5"
            )
        elif isinstance(content, Mapping) and not isinstance(name, str):
            yield (
                f"{place}: the key {name} is {_kind(name)} to YAML; write it in quotes, as in "
                "'2024-05-13': or 'on':"
            )
        yield from _keys_that_are_no_text(value, where, f"{key}.{name}".lstrip("."))
        before = name, value


def _is_fraction(name: object, value: object, before: object) -> bool:
    """Whether a key is the rest of a number with a decimal comma.

    YAML reads {value: 40,0} as {value: 40, 0: null}, and {value: 40,0 unit: mm} as {value: 40,
    '0 unit': mm}.
    """
    words = str(name).partition(" ")
    return type(before) is int and words[0].isdecimal() and (bool(words[1]) or value is None)


def _kind(value: object) -> str:
    """Name the type that YAML gives to an unquoted word."""
    if isinstance(value, bool):
        return "true or false"
    if value is None:
        return "nothing"
    return "a date" if isinstance(value, datetime.date) else "a number"


def _sentences(error: Any, where: str) -> list[str]:
    key = ".".join(map(str, error.absolute_path))
    place = f"{where}, {key}" if key else where
    written = repr(error.instance)[:60]
    match error.validator:
        case "additionalProperties":
            known = list(error.schema.get("properties", {}))
            unknown = [name for name in error.instance if name not in known]
            return [
                f"{place}: {name!r} is a study, which belongs under `studies:`; move it there, "
                "indented"
                if _is_study(error.instance[name])
                else f"{place}: unknown key {name!r}{nearest(str(name), known)}"
                for name in unknown
            ]
        case "required":
            missing = [name for name in error.validator_value if name not in error.instance]
            named = [name for name in missing if f"{name!r} is a required" in error.message]
            return [f"{place}: {name!r} is missing{_purpose(error, name)}" for name in named]
        case "enum":
            known = [str(value) for value in error.validator_value]
            return [f"{place}: unknown value {written}{nearest(str(error.instance), known)}"]
        case "type":
            types = error.validator_value
            types = [types] if isinstance(types, str) else types
            wanted = " or ".join(TYPE_NAMES[kind] for kind in types)
            if "string" in types and not isinstance(error.instance, list | Mapping | None):
                written = f"{error.instance}, which is {_kind(error.instance)}: write it in quotes"
            return [f"{place}: expected {wanted}, found {written}{_description(error)}"]
        case "pattern" | "propertyNames" | "anyOf" | "oneOf" | "not":
            return [f"{place}: {written} is not possible here{_description(error)}"]
        case limit if limit in LIMITS:
            wanted = LIMITS[limit].format(error.validator_value)
            return [f"{place}: must be {wanted}, found {written}{_description(error)}"]
    return [f"{place}: {error.message}"]


def _is_study(value: object) -> bool:
    return isinstance(value, Mapping) and "specimen" in value


def _purpose(error: Any, name: str) -> str:
    description = error.schema.get("properties", {}).get(name, {}).get("description", "")
    return f"; add it ({_first(description)})" if description else "; add it"


def _description(error: Any) -> str:
    description = error.schema.get("description", "")
    return f"; this key is: {_first(description)}" if description else "; correct it"


def _first(description: str) -> str:
    return description.split(". ")[0].rstrip(".")


FLOAT = re.compile(
    r"^[-+]?(?:\d[\d_]*\.[\d_]*(?:[eE][-+]?\d+)?|\d[\d_]*[eE][-+]?\d+|\.\d+(?:[eE][-+]?\d+)?"
    r"|\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$|^-\.(?:inf|Inf|INF)$"
)


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

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
        written = "nothing" if content is None else repr(content)[:60]
        raise UserError(f"{path}: expected `key: value` lines, found {written}")
    return content


def scalar(text: str) -> str:
    """Return the text as a YAML scalar, in quotes if needed."""
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
            # Check the keys as written; merge keys (`<<: *other`) are expanded later.
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
