"""What goes wrong because of what a user gave, said in one sentence each."""

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


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which known name `name` may have meant: ``"; did you mean 'creep'?"``."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(sorted(known))}"
