"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path

import click

EXISTING = click.Path(exists=True, path_type=Path)
TARGET = click.Path(path_type=Path)
CONFIG = click.option(
    "--config",
    type=TARGET,
    default=Path("config.yaml"),
    show_default=True,
    help="Where studies given by name are described, and systems of one's own named.",
)
RESULTS = click.option(
    "--results",
    type=TARGET,
    default=Path("results"),
    show_default=True,
    help="Where the results of studies given by name are.",
)
CONDITIONS = click.option(
    "--condition",
    "conditions",
    multiple=True,
    metavar="NAME=VALUE",
    help="What is held under --excitation, such as load_g=300.",
)
