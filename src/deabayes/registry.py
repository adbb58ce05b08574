"""Registries: what is offered by name, each in the module of that name."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any


def load(package: str, names: Mapping[str, str]) -> dict[str, Any]:
    """Name -> the object that `names` says, from the module `package`.name, a dash written `_`."""
    return {
        name: getattr(import_module(f"{package}.{name.replace('-', '_')}"), attribute)
        for name, attribute in names.items()
    }
