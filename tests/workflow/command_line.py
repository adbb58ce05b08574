"""The `deabayes` command in a process of its own, and its messages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def deabayes(*arguments: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "deabayes.cli.main", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "DEABAYES_DATA": ""},
        check=False,
    )


def assert_one_message(run: subprocess.CompletedProcess[str], status: int, *words: str) -> None:
    assert run.returncode == status, run.stderr
    assert "Traceback" not in run.stderr, run.stderr
    assert run.stdout == "", run.stdout
    for word in words:
        assert word in run.stderr, f"{word!r} is not in {run.stderr!r}"
