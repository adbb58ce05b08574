"""Commands on folders, records and downloads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from deabayes.cli.arguments import CONFIG, TARGET, find_population, find_study
from deabayes.faults import Report

if TYPE_CHECKING:
    from deabayes.population.settings import Population
    from deabayes.study import Study


@click.command()
@click.argument("name")
@click.argument("more", nargs=-1, type=TARGET, metavar="")
@click.option("--system", help="tubular, tensile_strip, ...; guessed from files if it can be.")
@click.option(
    "--from", "first", type=TARGET, metavar="FILE...", help="Records to draft the folder from."
)
@click.option("--folder", type=TARGET, default=Path("data"), show_default=True)
@CONFIG
def new(
    name: str,
    more: Sequence[Path],
    system: str | None,
    first: Path | None,
    folder: Path,
    config: Path,
) -> None:
    """Write a commented study folder to fill in, and print its config entry.

    With --from FILE..., experiments.csv gets a row per file, and a question mark stands
    behind each guess.
    """
    files = [*([] if first is None else [first]), *more]
    click.echo(new_by_name(name, system, folder, config, files, first is not None), nl=False)


@click.command()
@click.argument("what")
@CONFIG
def check(what: str, config: Path) -> None:
    """Check a study folder: print what was understood and every fault found.

    WHAT is a folder (data/NAME), or the name of a study: then also what
    config.yaml asks of its records; or that of a population: then all its studies.
    A file with one study's settings (results/NAME/study.yaml) is checked as the
    study, but no model is solved.
    Ends with status 1 if anything is at fault.
    """

    check_by_name(what, config, click.echo)


@click.command()
@click.argument("studies", nargs=-1)
@CONFIG
def data(studies: Sequence[str], config: Path) -> None:
    """Download the public data sets that STUDIES (default: all) need, checked by SHA-256."""
    for line in download(studies, config):
        click.echo(line)


def check_by_name(what: str, config: Path, say: Callable[[str], None]) -> None:
    """Check a study folder, a study with its folder, or a population and its studies.

    A name in the config means the study, even if a folder has the same name. Faults are raised
    after everything is printed.
    """
    from deabayes.population.settings import load_populations

    a_path = Path(what).is_dir() or Path(what).name != what
    if Path(what).name == "study.yaml":
        _check_study(find_study(what, config), say, None)
    elif a_path and not _names_entry(config, what):
        _check_folder(Path(what), config, say)
    elif any(each.name == what for each in load_populations(config)):
        _check_population(find_population(what, config), config, say)
    else:
        _check_study(find_study(what, config), say, config)


def _names_entry(config: Path, what: str) -> bool:
    """Whether a config has a study or population with the name of this folder."""
    from deabayes.records.schema import read_yaml

    if Path(what).name != what or not Path(config).is_file():
        return False
    content = read_yaml(config)
    return any(what in (content.get(key) or ()) for key in ("studies", "populations"))


def _check_folder(folder: Path, config: Path, say: Callable[[str], None]) -> None:
    from deabayes.checks.folder import check_folder
    from deabayes.own_models.loading import load_for
    from deabayes.records.specimen import system_named

    load_for(system_named(folder), config)
    report = check_folder(folder)
    say(report.text(with_faults=False))
    report.raise_faults()


def _check_study(study: Study, say: Callable[[str], None], config: Path | None) -> None:
    """Print the check of a study's folder, then of the study.

    Without a config, neither `prior_from` is checked nor a model solved.
    """
    from deabayes.checks.folder import check_folder, counted
    from deabayes.checks.study import check_study

    folder = check_folder(study.specimen, study.data_root, as_study=False)
    report = check_study(study, compare=config is not None, read=folder.read)
    if config is not None and not report.faults:
        _check_prior_source(study, config, report)
    folder.faults = [fault for fault in folder.faults if fault in report.faults]
    its_own = len(report.faults) > len(folder.faults)
    say(folder.text(with_faults=False, with_count=not its_own))
    if its_own:
        count = counted(report.faults, [*folder.warnings, *report.warnings])
        say(f"\n{count} in {folder.folder} and study {study.name}")
    elif report.warnings:
        plural = "s" if report.warnings[1:] else ""
        say(f"\n{len(report.warnings)} warning{plural} on study {study.name}")
    for warning in report.warnings:
        say(f"  - {warning}")
    report.raise_faults()


def _check_prior_source(study: Study, config: Path, report: Report) -> None:
    """Report faults and warnings on the posterior that a study takes as its prior."""
    from deabayes.checks.prior_sources import Sources
    from deabayes.population.settings import load_populations
    from deabayes.studies import load_studies

    if study.prior_from is None:
        return
    studies = {each.name: each for each in load_studies(config)}
    populations = {each.name: each for each in load_populations(config)}
    sources = Sources(studies, populations)
    report.include(sources.faults(study))
    if not report.faults:
        report.include(warnings=sources.cautions(study))


def _check_population(population: Population, config: Path, say: Callable[[str], None]) -> None:
    """Print the check of every member of a population whose settings are sound."""
    say(
        f"population {population.name}: {len(population.studies)} specimens by "
        f"{population.candidate}, {', '.join(population.parameters)} scatter between them"
    )
    report = Report()
    for name in population.studies:
        say("")
        with report.catching():
            _check_study(find_study(name, config), say, config)
    report.raise_faults()


def checked(study: Study, compare: bool = False) -> list[str]:
    """Raise the faults of a study; return its warnings."""
    from deabayes.checks.study import check_study

    report = check_study(study, compare)
    report.raise_faults()
    return report.warnings


def new_by_name(
    name: str, system: str | None, folder: Path, config: Path, files: Sequence[Path], drafted: bool
) -> str:
    """Write a study folder to fill in; return its entry for the config.

    Parameters
    ----------
    drafted : whether `--from` was given, before the first of the files.
    """
    from deabayes.own_models.loading import load_for
    from deabayes.records.scaffold import new_study

    if files and not drafted:
        raise click.UsageError(f"{files[0]}: write --from before the first file")
    if system is None and not files:
        raise click.UsageError("give --system, or the files of its records: --from FILE...")
    if Path(name).is_file():
        raise click.UsageError(
            f"{name} is a file; the study's name comes first: NAME --from FILE..."
        )
    if system is not None:
        load_for(system, config)
    return new_study(name, system, folder, files)


def download(studies: Sequence[str], config: Path) -> Iterator[str]:
    """Fetch the public records of the studies; one line per specimen folder."""
    from deabayes.records.download import fetch
    from deabayes.studies import load_studies

    wanted = [find_study(name, config) for name in studies] or load_studies(config)
    for folder, root in dict.fromkeys((study.specimen, study.data_root) for study in wanted):
        place = fetch(folder, root, progress=True)
        if place != folder:
            yield f"{folder}: records are in {place}"
