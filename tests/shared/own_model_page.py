"""The files that docs/how-to/own-model.md shows, as they stand there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from deabayes.cli.main import main

MODEL = Path("models/stack.py")
PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own-model.md"
FILE = re.compile(r"`(?P<path>[\w/.]+)`:\n\n```\w+\n(?P<text>.*?)```", re.DOTALL)


def write_page(folder: Path) -> Path:
    """Write every file of the page into a folder, and let it make its records."""
    files = {match["path"]: match["text"] for match in FILE.finditer(PAGE.read_text("utf-8"))}
    assert sorted(files) == [
        "config.yaml",
        "data/stack/experiments.csv",
        "data/stack/specimen.yaml",
        "make_records.py",
        "models/stack.py",
    ]
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, "make_records.py"], cwd=folder, check=True)
    return folder


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command says on standard error; it must end with status 1."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 1
    return capsys.readouterr().err
