"""The question mark behind a guess of `deabayes new --from`; who confirms the guess removes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MARK = "?"
UNKNOWN = "[?]"
"""A unit that no file states; it is to be filled in, so it needs no mark behind it."""


def marked(text: str) -> str:
    """Return a guess with its mark."""
    return text if text.endswith((MARK, UNKNOWN)) else f"{text}{MARK}"


def without_mark(text: str) -> str:
    """Return a text without the mark behind it; a mark alone stays, for something to fill in."""
    bare = text.strip()
    is_guess = bare.endswith(MARK) and not bare.endswith(UNKNOWN) and bare != MARK
    return bare.removesuffix(MARK).rstrip() if is_guess else text


def without_marks(cell: str) -> tuple[str, list[str]]:
    """Return a cell of parts with ``;`` between them, without marks, and the marked parts."""
    parts = cell.split(";")
    bare = [without_mark(part) for part in parts]
    guesses = [b for part, b in zip(parts, bare, strict=True) if b != part]
    return ("; ".join(bare) if guesses else cell), guesses


def without_marks_in(value: Any, key: str) -> tuple[Any, list[str]]:
    """Return a value of a YAML file without marks, and ``key: value`` for each marked text."""
    if isinstance(value, Mapping):
        read = {name: without_marks_in(item, f"{key}.{name}") for name, item in value.items()}
        return {n: item for n, (item, _) in read.items()}, [
            g for _, gs in read.values() for g in gs
        ]
    if isinstance(value, str) and without_mark(value) != value:
        return without_mark(value), [f"{key}: {without_mark(value)}"]
    return value, []


def confirm(guesses: list[str]) -> str:
    """Say what to do with guesses."""
    each = "each" if guesses[1:] else "the"
    return f"guessed {', '.join(guesses)}; correct what is wrong, and remove {each} ?"
