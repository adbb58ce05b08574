"""Progress of a run in one line, rewritten on a terminal and repeated now and then in a log."""

from __future__ import annotations

import sys
import time

IN_A_LOG = 10.0
"""Seconds between two lines of a log, unless the state changes."""


class Progress:
    """A line on stderr: state, steps, smallest effective sample size, R-hat and time left."""

    def __init__(self, shown: bool = False) -> None:
        self._shown, self._state, self._last, self._width = shown, "", 0.0, 0

    def say(
        self,
        state: str,
        steps: int | None = None,
        ess: float | None = None,
        r_hat: float | None = None,
        left: float | None = None,
    ) -> None:
        """Write the progress line without the values that are not known yet.

        Parameters
        ----------
        left : estimated time left [s].
        """
        if not self._shown:
            return
        parts = [state]
        if steps is not None:
            parts.append(f"{steps} steps")
        if ess is not None:
            parts.append(f"smallest ESS {ess:.0f}")
        if r_hat is not None:
            parts.append(f"R-hat {r_hat:.3f}")
        if left is not None:
            parts.append(f"about {duration(left)} left")
        self._write(", ".join(parts), state)

    def _write(self, line: str, state: str) -> None:
        now = time.monotonic()
        if sys.stderr.isatty():
            sys.stderr.write("\r" + line.ljust(self._width))
            self._width = len(line)
        elif state != self._state or now - self._last >= IN_A_LOG:
            sys.stderr.write(line + "\n")
            self._last = now
        self._state = state
        sys.stderr.flush()

    def end(self) -> None:
        """End the line on a terminal."""
        if self._shown and sys.stderr.isatty():
            sys.stderr.write("\n")


def duration(seconds: float) -> str:
    """Return a duration in words, such as `40 s` or `3 min`."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
