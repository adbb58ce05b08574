"""Mistakes of users: errors with one sentence each."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class UserError(Exception):
    """A mistake in the user's files or call.

    The message names the file, row or key, what was found and what to do; the
    command line prints it without a traceback and exits with status 1.
    """


class Faults(UserError):
    """Several mistakes found in one pass, reported together."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(self.faults))


class MissingQuantity(UserError):
    """A quantity that a model needs and the specimen does not have.

    Attributes
    ----------
    quantity, unit : what is missing, and its SI unit.
    """

    def __init__(self, specimen: str, quantity: str, unit: str, purpose: str = "") -> None:
        self.quantity, self.unit = quantity, unit
        needed = f", which {purpose} needs" if purpose else ""
        super().__init__(
            f"specimen {specimen!r} lacks {quantity}{needed}; add it to "
            f"quantities in specimen.yaml, in {unit}"
        )


def closest(name: object, known: Iterable[object]) -> str | None:
    """The known name closest to `name`, or None; a key that is no text (2024) counts as written."""
    close = difflib.get_close_matches(str(name), [str(each) for each in known], n=1, cutoff=0.6)
    return close[0] if close else None


def nearest(name: object, known: Iterable[object]) -> str:
    """Say which known name `name` may have meant: ``"; did you mean 'creep'?"``."""
    names = [str(each) for each in known]
    if not names:
        return ""
    meant = closest(name, names)
    return f"; known: {', '.join(sorted(names))}" if meant is None else f"; did you mean {meant!r}?"


def rename_hint(name: object, unknown: Iterable[object]) -> str:
    """Say which unknown name to call `name`: ``"; 'roll' is not known: rename it 'role'?"``."""
    meant = closest(name, unknown)
    return "" if meant is None else f"; {meant!r} is not known: rename it {str(name)!r}?"
