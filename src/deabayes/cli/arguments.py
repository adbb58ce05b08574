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
    help="A constant condition of the experiment, such as load_g=300 (with --excitation).",
)


INDEX = "index.json"
"""Lists what is in a folder of figures or of analyses."""
OF_A_STUDY = ("specimen.yaml", "study.yaml", "population.yaml")
"""Files by which a folder is recognised as one of records or of results."""


def keep_inputs(output: Path | None, *inputs: Path | None, option: str = "-o") -> None:
    """Refuse an output that is also an input, however its path is written."""
    if output is None or not output.exists():
        return
    for source in inputs:
        if source is not None and source.exists() and output.samefile(source):
            kind = "folder" if output.is_dir() else "file"
            raise UserError(f"{option} {output}: this {kind} is an input; name another {kind}")


def check_folder(output: Path, option: str = "-o") -> None:
    """Refuse a file where a folder is to be written."""
    if output.is_file():
        raise UserError(f"{option} {output}: is a file; name a folder")


def check_folder_of(kind: str, output: Path, key: str, replaced: bool = False) -> None:
    """Refuse a folder that holds records, results, or another kind of output than `kind`.

    Parameters
    ----------
    key : key that every entry of the folder's index has.
    replaced : whether the folder is replaced as a whole. A folder with other files is then
        refused too.
    """
    check_folder(output)
    for name in OF_A_STUDY:
        if (output / name).is_file():
            raise UserError(f"-o {output}: holds {name}; name a folder that holds only {kind}")
    index = output / INDEX
    if index.is_file() and not _lists(index, key):
        raise UserError(f"-o {output}: its {INDEX} lists no {kind}; name another folder")
    files = sorted(output.iterdir()) if output.is_dir() else []
    if replaced and files and not index.is_file():
        raise UserError(
            f"-o {output}: the command would delete this folder with {files[0].name}; name a new "
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
    studies = {known.name: known for known in load_studies(config)}
    if study in studies:
        return studies[study]
    if study in read_yaml(config)["studies"]:
        parts = [n for n, part in studies.items() if part.select and n.startswith(f"{study}_")]
        raise UserError(
            f"{config}: study {study} is split into {', '.join(parts)}; name one of them"
        )
    raise UserError(f"{config}: has no study {study!r}{nearest(study, studies)}")


def find_population(name: str, config: Path) -> Population:
    """Find a population of a config by name, and check it against its studies."""
    from deabayes.population.checks import check_population
    from deabayes.population.settings import load_populations
    from deabayes.studies import load_studies

    populations = {known.name: known for known in load_populations(config)}
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
    folders: dict[Path, Path] = {}
    for name in names:
        folder = results / name if (results / name).exists() else Path(name)
        if not folder.exists():
            raise _unknown(name, "results folder", results)
        folders.setdefault(folder.resolve(), folder)
    return list(folders.values())


def posterior_files(sources: Sequence[str], results: Path) -> list[Path]:
    """Posterior files given as paths, or of one STUDY/CANDIDATE, or all of one study by name."""
    from deabayes.posteriors.storage import fitted_posteriors

    missing = [source for source in sources if not Path(source).is_file()]
    if not missing:
        return [Path(source) for source in sources]
    if len(sources) > 1:
        raise UserError(f"{missing[0]}: no such posterior file")
    of_candidate = results / sources[0] / "posterior.nc"
    files = [of_candidate] if of_candidate.is_file() else fitted_posteriors(results / sources[0])
    if not files:
        raise _unknown(sources[0], "posterior file", results)
    return files


def one_posterior(source: str, results: Path) -> Path:
    """One posterior file, given as a path, STUDY/CANDIDATE or a study with one fitted candidate."""
    if Path(source).is_dir() and not (results / source).exists():
        return Path(source)  # opening it says which posterior files are in it
    files = posterior_files([source], results)
    if len(files) > 1:
        choices = " or ".join(f"{source}/{file.parent.name}" for file in files)
        raise UserError(f"study {source} has {len(files)} fitted candidates; give {choices}")
    return files[0]


def _unknown(name: str, kind: str, results: Path) -> UserError:
    """Say that a name is unknown, and which fitted study, or candidate, it may mean."""
    parts = slice(-3, -1) if "/" in name else slice(-3, -2)
    fitted = sorted({"/".join(p.parts[parts]) for p in results.glob("*/*/posterior.nc")})
    hint = nearest(name, fitted) if fitted else "; run `deabayes fit` first"
    return UserError(f"{name!r} is neither a {kind} nor a fitted study under {results}{hint}")


def named_values(settings: Sequence[str], option: str) -> dict[str, float | str]:
    """Split NAME=VALUE pairs; a value that is no number stays text."""
    values: dict[str, float | str] = {}
    for setting in settings:
        name, _, value = (part.strip() for part in setting.partition("="))
        if not name or not value:
            raise UserError(f"{option} {setting!r}: expected NAME=VALUE")
        if name in values:
            raise UserError(f"{option}: {name} is given twice; keep one")
        try:
            values[name] = float(value)
        except ValueError:
            values[name] = value
    return values
