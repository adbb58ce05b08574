"""Whether an error is a mistake in a user's model, and where it is."""

from __future__ import annotations

import traceback
from pathlib import Path

PACKAGE = str(Path(__file__).parents[1])
OURS = (RuntimeError, OSError, ImportError, MemoryError, SystemError)
"""What arguments do not cause: raised in what a model calls, these are no mistake of the model."""


def fault_of(error: BaseException, path: Path) -> str | None:
    """Where in a model's file an error arose, and which; None if it is not the model's.

    It is the model's where, of its code and this package's, its own was last to run. What the
    package could not do with what the model called it with is said as that.
    """
    file = str(path.resolve())
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file or Path(frame.filename).is_relative_to(PACKAGE)
    ]
    own = [frame for frame in frames if frame.filename == file]
    if not own:
        return None
    place = f"{path}, line {own[-1].lineno}"
    if frames[-1].filename == file:
        return f"{place}: {said(error)}; correct the model there"
    if isinstance(error, OURS):
        return None
    called = Path(frames[-1].filename).relative_to(PACKAGE).with_suffix("")
    module = ".".join(("deabayes", *called.parts))
    return f"{place}: {module}, called there, raises {said(error)}; correct what it is given"


def said(error: BaseException) -> str:
    """The kind of an error and its words, in one line."""
    words = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}: {words}".replace("\n", " ").rstrip(": ")
