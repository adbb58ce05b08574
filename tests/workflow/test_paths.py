"""Folders may have spaces in their names."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from tests.shared.own_model_page import write_page
from tests.shared.study_folders import replace_in
from tests.workflow.snakemake_runs import ROOT, snakemake


def test_paths_may_hold_spaces(tmp_path: Path) -> None:
    place = write_page(tmp_path / "sp ace ü")
    pathvars = 'pathvars: {results: "my results"}\n'
    (place / "config.yaml").write_text(pathvars + (place / "config.yaml").read_text())
    shutil.move(place / "models", place / "my models")
    replace_in(place / "config.yaml", "models/stack.py", "my models/stack.py")
    made = place / "my results" / "stack" / "prepared" / "creep_1000V.nc"
    run = snakemake(place, "--cores", "1", made.relative_to(place))
    assert run.returncode == 0, run.stderr
    assert made.is_file() and "my models/stack.py" in made.with_suffix(".yaml").read_text()


def test_every_path_of_every_command_is_quoted() -> None:
    """One that is not would break only where a folder's name has a space."""
    text = "".join(path.read_text() for path in (ROOT / "workflow" / "rules").glob("*.smk"))
    commands = re.findall(r"^    shell:\n((?:        .*\n)+)", text, re.MULTILINE)
    used = re.findall(r"\{([^{}]+)\}", "".join(commands))
    assert len(used) > 30
    assert {each for each in used if not each.endswith(":q")} == set()
