"""What is to be studied: a specimen, its candidates, and how they are judged."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from deabayes.faults import Faults, UserError, nearest
from deabayes.files import write_text_atomically

Settings = Mapping[str, object]
AFTER_THE_FIT = ("further_experiments", "evidence_check")
"""Settings that study.yaml does without: what depends on one is told it otherwise."""
OF_OTHER_FITS = ("candidates", "validate")
"""Settings that no fit of one candidate depends on: editing one samples nothing again."""


@dataclass(frozen=True)
class Sampling:
    """How hard to sample, and what counts as converged (inference.md, Sampling)."""

    ensembles: int = 4
    walkers: int = 128
    max_steps: int = 20000
    ess: float = 400.0
    r_hat: float = 1.01
    autocorrelation_times: float = 50.0
    particles: int = 1024
    seed: int = 1

    def __post_init__(self) -> None:
        for each in fields(self):  # YAML and its schema take 4.0 for a whole number
            if each.type == "int":
                object.__setattr__(self, each.name, int(getattr(self, each.name)))


@dataclass(frozen=True)
class Study:
    """One entry of `studies:` in config.yaml, with the sampling settings it is run under."""

    name: str
    specimen: Path
    candidates: tuple[str, ...]
    calibrate: tuple[str, ...] | None = None
    validate: tuple[str, ...] | None = None
    noise: str = "ornstein_uhlenbeck"
    noise_scale: Literal["absolute", "range"] = "absolute"
    noise_groups: Literal["protocol", "experiment"] = "protocol"
    noise_coordinate: Literal["record", "grid"] = "record"
    preparation: Mapping[str, Sequence[Mapping[str, Settings]]] = field(default_factory=dict)
    priors: Mapping[str, Settings] = field(default_factory=dict)
    prior_from: str | None = None
    predict_with: Mapping[str, str] = field(default_factory=dict)
    """Protocol -> ending of the candidate that predicts its held-out records (`_inertia`)."""
    select: Mapping[str, str] = field(default_factory=dict)
    """Keep only the experiments whose column equals the value (from `split_by`)."""
    further_experiments: Mapping[str, Settings] = field(default_factory=dict)
    """Experiments that could be done next, each like a record with some factors."""
    evidence_check: Literal["nested"] | None = None
    """A second estimate of the evidence, by nested sampling."""
    model: Path | None = None
    """File that defines the specimen's system, where that is the user's own."""
    data_root: Path | None = None
    """Local copy of the public data sets; else the environment variable DEABAYES_DATA."""
    sampling: Sampling = field(default_factory=Sampling)


def load_studies(config: Path | Mapping[str, Any], where: str | None = None) -> tuple[Study, ...]:
    """Every study of a config, in order; `split_by` gives one per value of the column.

    Parameters
    ----------
    config : path of config.yaml, or what it holds.
    where : for a mapping, the file or files (``a.yaml, b.yaml``) it was read from.
        Folders are relative to the config's own folder (the working directory
        where there is no file).

    Raises
    ------
    Faults : every violation of the schema (schemas/config.schema.yaml), and of what it names.
    """
    from deabayes.own_models.files import load_named
    from deabayes.reading.schema import violations
    from deabayes.reading.yaml_file import read_yaml

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
    """One study: of a file that holds just its settings (study.yaml), or by name of a config.

    Folders in a study.yaml are relative to the working directory, as `to_settings` gives them.
    The system that its `model` defines is loaded.

    Raises
    ------
    Faults, UserError : violations of the schema, or no study of this name.
    """
    from deabayes.own_models.files import load_named
    from deabayes.reading.schema import violations
    from deabayes.reading.yaml_file import read_yaml

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
        raise UserError(f"{path}, split_by: makes several studies, and this file holds one; put "
                        f"it under `studies: {{{name}: ...}}` of a config, or give the part that "
                        "is meant by `select: {COLUMN: VALUE}`")  # fmt: skip
    load_named({"studies": {name: content}}, [Path()], str(path))
    return from_settings({"name": name, **content})


def write_study(study: Study, path: Path) -> None:
    """Write a study.yaml; a file that says the same already is left alone, time stamp and all."""
    import yaml

    text = yaml.safe_dump(to_settings(study), sort_keys=False, allow_unicode=True)
    path = Path(path)
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return
    write_text_atomically(text, path)


def to_settings(study: Study) -> dict[str, Any]:
    """The study as plain lists, mappings, texts and numbers, ready for YAML or JSON."""
    settings: dict[str, Any] = _plain(asdict(study))
    return settings


def settings_on_file(study: Study) -> dict[str, Any]:
    """The settings as the workflow's study.yaml has them."""
    return {key: v for key, v in to_settings(study).items() if key not in AFTER_THE_FIT}


def fit_settings(study: Study) -> dict[str, Any]:
    """The settings that the fit of a candidate depends on."""
    return {key: v for key, v in settings_on_file(study).items() if key not in OF_OTHER_FITS}


def from_settings(settings: Mapping[str, Any]) -> Study:
    """The study that `to_settings` gave, or a config entry with its `name` put in."""
    given = {k: v for k, v in settings.items() if v is not None and k != "split_by"}
    for key in ("candidates", "calibrate", "validate"):
        if key in given:
            given[key] = tuple(given[key])
    for key in ("specimen", "model", "data_root"):
        if key in given:
            given[key] = Path(given[key])
    if "select" in given:
        given["select"] = {key: str(value) for key, value in given["select"].items()}
    given["sampling"] = Sampling(**(given.get("sampling") or {}))
    study = Study(**given)
    both = set(study.calibrate or ()) & set(study.validate or ())
    if both:
        raise UserError(
            f"{', '.join(sorted(both))} is listed under calibrate and under validate; "
            "a held-out record must not be fitted, remove it from one"
        )
    return study


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def _with_defaults(settings: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, Any]:
    """A study's settings with the config's `sampling` and `data_root` beneath its own."""
    sampling = {**(content.get("sampling") or {}), **(settings.get("sampling") or {})}
    return {"data_root": content.get("data_root"), **settings, "sampling": sampling}


def _with_files(study: Study, bases: Sequence[Path], own: Mapping[str, Path]) -> Study:
    """The study with its folders seen from the working directory, and its system's file."""
    from deabayes.own_models.files import model_of, seen

    found = [base for base in bases if (base / study.specimen).is_dir()]
    base = found[0] if found else bases[0]
    specimen, root = Path(os.path.normpath(base / study.specimen)), study.data_root
    return replace(
        study,
        specimen=specimen,
        prior_from=None if study.prior_from is None else _from_here(study.prior_from),
        model=model_of(specimen, own) if study.model is None else seen(study.model, bases),
        data_root=None if root is None else Path(os.path.normpath(base / root.expanduser())),
    )


def _from_here(path: str) -> str:
    """A path in the one spelling that Snakemake knows it by: `./results/x` is `results/x`."""
    place = Path(os.path.normpath(path))
    return (place.relative_to(Path.cwd()) if place.is_relative_to(Path.cwd()) else place).as_posix()


def _split(study: Study, column: str | None) -> list[Study]:
    """One study per value of `column` of experiments.csv, or the study itself without one."""
    if column is None:
        return [study]
    from deabayes.reading.selection import told_apart_by, values_of
    from deabayes.reading.table import read_table

    rows = read_table(study.specimen)
    parts = []
    for value in values_of(study.specimen, column):
        # A name that no part knows stays in all, to be said.
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
    """No two studies share a results folder (`split_by` may make them), also where case is lost."""
    seen: set[str] = set()
    for study in studies:
        if study.name.lower() in seen:
            raise UserError(f"{where}: two studies are called {study.name!r}; rename one")
        seen.add(study.name.lower())
