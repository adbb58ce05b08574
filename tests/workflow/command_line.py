"""The `deabayes` command and its messages."""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

from deabayes.cli.main import main

ROOT = Path(__file__).resolve().parents[2]


def deabayes(*arguments: str | Path, cwd: Path = ROOT) -> CompletedProcess[str]:
    """Run a command in this process; what it prints and its exit status, as of a process."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    words, status = [str(each) for each in arguments], 0
    with (
        contextlib.chdir(cwd),
        patch.dict(os.environ, DEABAYES_DATA=""),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main(words)
        except SystemExit as ended:
            status = int(ended.code or 0)
    said = []
    for stream in (out, err):
        stream.seek(0)
        said.append(stream.read())
    return CompletedProcess(words, status, *said)


def assert_one_message(run: CompletedProcess[str], status: int, *words: str) -> None:
    assert run.returncode == status, run.stderr
    assert "Traceback" not in run.stderr, run.stderr
    assert run.stdout == "", run.stdout
    for word in words:
        assert word in run.stderr, f"{word!r} is not in {run.stderr!r}"
