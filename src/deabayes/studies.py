"""Read and write studies: all studies of a config, or one from its own file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from deabayes.faults import Faults, UserError, nearest
from deabayes.files import write_text_atomically
from deabayes.own_models.loading import load_named, model_of, seen
from deabayes.records.schema import read_yaml, violations
from deabayes.records.table import read_table, told_apart_by, values_of
from deabayes.study import Study, from_settings, to_settings


def load_studies(config: Path | Mapping[str, Any], where: str | None = None) -> tuple[Study, ...]:
    """Read every study of a config, in order; `split_by` makes one study per value of a column.

    Parameters
    ----------
    config : path of config.yaml, or its content.
    where : for a mapping, the file or files (``a.yaml, b.yaml``) from which it was read.
        Folders are relative to the config's own folder, or to the working directory if there is
        no file.

    Raises
    ------
    Faults : all violations of the schema (schemas/config.schema.yaml), and all other mistakes.
    """
    content = dict(config) if isinstance(config, Mapping) else read_yaml(Path(config))
    place = where or ("config" if isinstance(config, Mapping) else str(config))
    faults = violations(content, "config", place)
    if faults:
        raise Faults(faults)
    bases = [Path(file).parent for file in place.split(", ") if Path(file).is_file()] or [Path()]
    own = load_named(content, bases, place)
    studies: list[Study] = []
    for name, settings in content["studies"].items():
        inherited = _with_defaults(settings, content)
        try:
            study = _with_files(from_settings({"name": name, **inherited}), bases, own)
            studies += _split(study, settings.get("split_by"))
        except UserError as error:
            faults += [f"{place}, studies.{name}: {fault}" for fault in str(error).splitlines()]
    if faults:
        raise Faults(faults)
    _check_names(studies, place)
    return tuple(studies)


def load_study(path: Path, name: str | None = None) -> Study:
    """Read one study: from a file with its settings (study.yaml), or by name from a config.

    Folders in a study.yaml are relative to the working directory, as `to_settings` gives them.
    The system that its `model` defines is loaded.

    Raises
    ------
    Faults, UserError : violations of the schema, or no study of this name.
    """
    content = read_yaml(Path(path))
    if "studies" in content:
        studies = {study.name: study for study in load_studies(Path(path))}
        if name is None and len(studies) > 1:
            raise UserError(f"{path}: has several studies; name one of {', '.join(studies)}")
        wanted = name or next(iter(studies))
        if wanted not in studies:
            raise UserError(f"{path}: has no study {wanted!r}{nearest(wanted, studies)}")
        return studies[wanted]
    name = str(content.pop("name", None) or name or Path(path).parent.name)
    faults = violations({"studies": {name: content}}, "config", str(path))
    if faults:
        raise Faults(faults)
    if content.get("split_by") is not None:
        raise UserError(
            f"{path}, split_by: makes several studies, but this file holds one; put the study "
            f"under `studies: {{{name}: ...}}` of a config, or choose one part with "
            "`select: {COLUMN: VALUE}`"
        )
    load_named({"studies": {name: content}}, [Path()], str(path))
    return from_settings({"name": name, **content})


def write_study(study: Study, path: Path) -> None:
    """Write study.yaml, unless the file already has this content (keeps its time stamp)."""
    write_settings(to_settings(study), path)


def write_settings(settings: Mapping[str, Any], path: Path) -> None:
    """Write settings as YAML, unless the file already has this content."""
    text = yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)
    path = Path(path)
    if not (path.is_file() and path.read_text(encoding="utf-8") == text):
        write_text_atomically(text, path)


def _with_defaults(settings: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, Any]:
    """Add the config's `sampling` and `data_root` if a study does not set them."""
    sampling = {**(content.get("sampling") or {}), **(settings.get("sampling") or {})}
    return {"data_root": content.get("data_root"), **settings, "sampling": sampling}


def _with_files(study: Study, bases: Sequence[Path], own: Mapping[str, Path]) -> Study:
    """Resolve a study's folders and model file from the working directory."""
    existing = [base for base in bases if (base / study.specimen).is_dir()]
    base = existing[0] if existing else bases[0]
    specimen, root = Path(os.path.normpath(base / study.specimen)), study.data_root
    return replace(
        study,
        specimen=specimen,
        prior_from=None if study.prior_from is None else _from_here(study.prior_from),
        model=model_of(specimen, own) if study.model is None else seen(study.model, bases),
        data_root=None if root is None else Path(os.path.normpath(base / root.expanduser())),
    )


def _from_here(path: str) -> str:
    """Normalise a path as Snakemake writes it: `./results/x` is `results/x`."""
    place = Path(os.path.normpath(path))
    return (place.relative_to(Path.cwd()) if place.is_relative_to(Path.cwd()) else place).as_posix()


def _split(study: Study, column: str | None) -> list[Study]:
    """Return one study per value of `column` of experiments.csv, or the study itself if None."""
    if column is None:
        return [study]
    rows = read_table(study.specimen)
    parts = []
    for value in values_of(study.specimen, column):
        # A name that no part has stays in every part, so that a check reports it.
        others = {row.name for row in rows if str(told_apart_by(row).get(column)) != value}
        parts.append(
            replace(
                study,
                name=f"{study.name}_{re.sub(r'[^A-Za-z0-9.-]+', '_', value).strip('_')}",
                select={**study.select, column: value},
                calibrate=_without(others, study.calibrate),
                validate=_without(others, study.validate),
                further_experiments={
                    key: settings
                    for key, settings in study.further_experiments.items()
                    if settings["like"] not in others
                },
            )
        )
    return parts


def _without(others: Set[str], listed: tuple[str, ...] | None) -> tuple[str, ...] | None:
    return None if listed is None else tuple(name for name in listed if name not in others)


def _check_names(studies: Sequence[Study], where: str) -> None:
    """Refuse studies that share a results folder, also on disks that ignore case."""
    names: set[str] = set()
    for study in studies:
        if study.name.lower() in names:
            raise UserError(f"{where}: two studies are called {study.name!r}; rename one")
        names.add(study.name.lower())
