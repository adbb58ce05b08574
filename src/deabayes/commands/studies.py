"""Commands on what a study is made of: folders, records, downloads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.commands.options import CONFIG, TARGET


@click.command()
@click.argument("name")
@click.option("--system", required=True, help="tubular, tensile_strip, ...")
@click.option("--folder", type=TARGET, default=Path("data"), show_default=True)
@CONFIG
def new(name: str, system: str, folder: Path, config: Path) -> None:
    """Write a commented study folder to fill in, and print its config entry."""
    from deabayes.commands.by_hand import new_by_name

    click.echo(new_by_name(name, system, folder, config), nl=False)


@click.command()
@click.argument("what")
@CONFIG
def check(what: str, config: Path) -> None:
    """Check a study folder: print what was understood and every fault found.

    WHAT is a folder (data/NAME), or the name of a study: then also what
    config.yaml asks of its records; or that of a population: then all its studies.
    Ends with status 1 if anything is at fault.
    """
    from deabayes.commands.checks import check_by_name

    check_by_name(what, config, click.echo)


@click.command()
@click.argument("studies", nargs=-1)
@CONFIG
def data(studies: Sequence[str], config: Path) -> None:
    """Download the public data sets that STUDIES (default: all) need, checked by SHA-256."""
    from deabayes.commands.by_hand import download

    for line in download(studies, config):
        click.echo(line)
