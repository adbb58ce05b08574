"""Mistakes and cautions of users: errors and warnings with one sentence each."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class UserError(Exception):
    """A mistake in the user's files or call.

    The message names the file, row or key, what was found and what to do; the
    command line prints it without a traceback and exits with status 1.
    """


class PredictionWarning(UserWarning):
    """A reason not to trust a prediction, which is also an attribute of its Dataset."""


class Faults(UserError):
    """Several mistakes found in one pass, reported together."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(self.faults))


class Report:
    """Faults and warnings in the order in which checks find them, each message once.

    Attributes
    ----------
    place : file, row or key with which the messages begin; empty for none.
    faults : what the user must correct.
    warnings : what the user must know.
    """

    def __init__(self, place: str = "") -> None:
        self.place = place
        self.faults: list[str] = []
        self.warnings: list[str] = []

    def at(self, place: str) -> Report:
        """Return the same report for messages about a place within this one."""
        within = Report(self._at(place))
        within.faults, within.warnings = self.faults, self.warnings
        return within

    def fault(self, message: str, key: str = "") -> None:
        """Add a fault, as ``place, key: message``."""
        self._add(self.faults, f"{self._at(key)}: {message}")

    def warn(self, message: str, key: str = "") -> None:
        """Add a warning, as ``place, key: message``."""
        self._add(self.warnings, f"{self._at(key)}: {message}")

    def include(self, faults: Iterable[str] = (), warnings: Iterable[str] = ()) -> None:
        """Add messages that name their own place, as ``place, message``."""
        for fault in faults:
            self._add(self.faults, self._at(fault))
        for warning in warnings:
            self._add(self.warnings, self._at(warning))

    @contextmanager
    def catching(self) -> Iterator[None]:
        """Include the faults of a `UserError` that is raised in this context."""
        try:
            yield
        except UserError as error:
            self.include(error.faults if isinstance(error, Faults) else [str(error)])

    def raise_faults(self) -> None:
        """Raise all faults together, if there are any."""
        if self.faults:
            raise Faults(self.faults)

    def _at(self, key: str) -> str:
        return ", ".join(filter(None, (self.place, key)))

    @staticmethod
    def _add(messages: list[str], message: str) -> None:
        message = message.removeprefix(": ")
        if message not in messages:
            messages.append(message)


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
