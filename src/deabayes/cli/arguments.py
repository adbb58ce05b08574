"""Arguments of commands: studies and results by name, and where a command may write."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from deabayes.faults import Faults, UserError, nearest

if TYPE_CHECKING:
    from deabayes.population.settings import Population
    from deabayes.study import Study

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


INDEX = "index.json"
"""Lists what is in a folder of figures or of analyses."""
OF_A_STUDY = ("specimen.yaml", "study.yaml", "population.yaml")
"""Files by which a folder is one of records or of results."""


def keep_inputs(output: Path | None, *inputs: Path | None, option: str = "-o") -> None:
    """Refuse an output that is also an input, however its path is written.

    Raises
    ------
    UserError
    """
    if output is None or not output.exists():
        return
    for source in inputs:
        if source is not None and source.exists() and output.samefile(source):
            kind = "folder" if output.is_dir() else "file"
            raise UserError(f"{option} {output}: is the {kind} that is read; name another")


def a_folder(output: Path, option: str = "-o") -> None:
    """Refuse a file where a folder is to be written.

    Raises
    ------
    UserError
    """
    if output.is_file():
        raise UserError(f"{option} {output}: is a file; name a folder")


def a_folder_of(kind: str, output: Path, key: str, option: str = "-o") -> None:
    """Refuse a folder that holds records, results, or another kind of output than `kind`.

    Parameters
    ----------
    key : what each entry of the folder's index has.

    Raises
    ------
    UserError
    """
    a_folder(output, option)
    for name in OF_A_STUDY:
        if (output / name).is_file():
            raise UserError(f"{option} {output}: holds {name}; name a folder for {kind} alone")
    index = output / INDEX
    if index.is_file() and not _lists(index, key):
        raise UserError(f"{option} {output}: its {INDEX} lists no {kind}; name another folder")


def a_folder_to_replace(kind: str, output: Path, key: str, option: str = "-o") -> None:
    """Like `a_folder_of`; also refuse a folder with files that are not of `kind`.

    Raises
    ------
    UserError
    """
    a_folder_of(kind, output, key, option)
    held = [*output.iterdir()] if output.is_dir() else []
    if held and not (output / INDEX).is_file():
        raise UserError(
            f"{option} {output}: is replaced as a whole, and holds {min(held).name}; name a new "
            "folder"
        )


def _lists(index: Path, key: str) -> bool:
    try:
        entries = json.loads(index.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(entries, list) and all(isinstance(e, dict) and key in e for e in entries)


def find_study(study: str, config: Path) -> Study:
    """Find a study by its settings file (`results/NAME/study.yaml`) or its name in `config`."""
    from deabayes.records.schema import read_yaml
    from deabayes.studies import load_studies, load_study

    if Path(study).suffix in (".yaml", ".yml"):
        return load_study(Path(study))
    studies = {each.name: each for each in load_studies(config)}
    if study in studies:
        return studies[study]
    if study in read_yaml(config)["studies"]:
        parts = [n for n, each in studies.items() if each.select and n.startswith(f"{study}_")]
        raise UserError(f"{config}: {study} is split into {', '.join(parts)}; name one of them")
    raise UserError(f"{config}: has no study {study!r}{nearest(study, studies)}")


def find_population(name: str, config: Path) -> Population:
    """Find a population of a config by name, and check it against its studies."""
    from deabayes.population.checks import check_population
    from deabayes.population.settings import load_populations
    from deabayes.studies import load_studies

    populations = {each.name: each for each in load_populations(config)}
    if name not in populations:
        hint = nearest(name, populations) or "; name one under `populations`"
        raise UserError(f"{config}: has no population {name!r}{hint}")
    studies = {study.name: study for study in load_studies(config)}
    faults = check_population(populations[name], studies)
    if faults:
        raise Faults(faults)
    return populations[name]


def study_folders(names: Sequence[str], results: Path) -> list[Path]:
    """Results folders given as paths, or as names of studies under `results`; names come first.

    Each folder is returned once.
    """
    folders = [each if (each := results / name).exists() else Path(name) for name in names]
    for name, folder in zip(names, folders, strict=True):
        if not folder.exists():
            raise _unknown(name, "results folder", results)
    once: dict[Path, Path] = {}
    for folder in folders:
        once.setdefault(folder.resolve(), folder)
    return list(once.values())


def found_posteriors(sources: Sequence[str], results: Path) -> list[Path]:
    """Posterior files given as paths, or all posteriors of one study given by name."""
    from deabayes.posteriors.storage import fitted_posteriors

    if all(Path(source).is_file() for source in sources):
        return [Path(source) for source in sources]
    if len(sources) > 1:
        missing = [source for source in sources if not Path(source).is_file()]
        raise UserError(f"{missing[0]}: no such posterior file")
    found = fitted_posteriors(results / sources[0])
    if not found:
        raise _unknown(sources[0], "posterior file", results)
    return found


def one_posterior(source: str, results: Path) -> Path:
    """One posterior file, given as a path or as the name of a study with one fitted candidate."""
    from deabayes.posteriors.storage import fitted_posteriors

    if Path(source).is_file():
        return Path(source)
    found = fitted_posteriors(results / source)
    if len(found) > 1:
        files = " or ".join(map(str, found))
        raise UserError(f"study {source} has {len(found)} fitted candidates; give {files}")
    if not found and not Path(source).is_dir():  # which files a folder holds is said on opening
        raise _unknown(source, "posterior file", results)
    return found[0] if found else Path(source)


def _unknown(name: str, kind: str, results: Path) -> UserError:
    """That a name is of nothing, and of which fitted study it may be meant."""
    fitted = sorted({path.parts[-3] for path in results.glob("*/*/posterior.nc")})
    hint = nearest(name, fitted) if fitted else "; run `deabayes fit` first"
    return UserError(f"{name!r} is neither a {kind} nor a fitted study under {results}{hint}")
