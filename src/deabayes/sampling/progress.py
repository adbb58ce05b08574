"""How far a run is, on a terminal as it goes, in a log file now and then."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm

ON_A_TERMINAL, IN_A_LOG = 0.1, 30.0
"""Seconds between two updates."""


def progress_bar(shown: bool, **options: Any) -> tqdm[Any]:
    """A bar on stderr, of tqdm's options; silent unless shown."""
    from tqdm import tqdm

    seconds = ON_A_TERMINAL if sys.stderr.isatty() else IN_A_LOG
    longest = max(10.0, seconds)
    return tqdm(disable=not shown, mininterval=seconds, maxinterval=longest, **options)
