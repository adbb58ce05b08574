"""Which files define systems of a user's own: what `models` and `model` in a config say."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deabayes.faults import Faults, UserError
from deabayes.own_models.loading import load_models
from deabayes.reading.schema import violations
from deabayes.reading.specimen import system_named
from deabayes.reading.yaml_file import read_yaml
from deabayes.systems import REGISTRY


def load_named(content: Mapping[str, Any], bases: Sequence[Path], where: str) -> dict[str, Path]:
    """Load the systems whose files a config names, once for all studies.

    Parameters
    ----------
    content : what the config holds, as its schema has it.
    bases : folders that its paths may be relative to.
    where : the config, for messages.

    Returns
    -------
    dict
        System -> its file, seen from the working directory.

    Raises
    ------
    Faults : every fault of every file.
    """
    files = list(content.get("models") or ())
    key = "models" if files else "model"
    files += [study["model"] for study in content["studies"].values() if study.get("model")]
    try:
        return load_models(*(seen(Path(file), bases) for file in files))
    except UserError as error:
        faults = str(error).splitlines()
        raise Faults(f"{where}, {key}: {fault}" for fault in faults) from None


def load_for(system: str, config: Path) -> None:
    """Load the files under `models` of a config, if there is one and the system does not ship.

    Nothing else of the config is looked at: the studies may be still to come.

    Raises
    ------
    Faults : as `load_named`, and a key `models` that is no list of files.
    """
    if not system or system in REGISTRY or not Path(config).is_file():
        return
    content = read_yaml(Path(config))
    faults = violations(content, "config", str(config))
    faults = [fault for fault in faults if fault.startswith(f"{config}, models")]
    if faults:
        raise Faults(faults)
    load_named({**content, "studies": {}}, [Path(config).parent], str(config))


def model_of(specimen: Path, own: Mapping[str, Path]) -> Path | None:
    """The file among these that defines the system of a study folder; None if it ships."""
    return own.get(system_named(specimen)) if own else None


def seen(file: Path, bases: Sequence[Path]) -> Path:
    """A config's file, seen from the working directory."""
    base = next((base for base in bases if (base / file).is_file()), bases[0])
    return Path(os.path.normpath(base / file))
