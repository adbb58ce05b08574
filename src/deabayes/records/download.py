"""Find and download public data that are not in the repository."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from deabayes.faults import UserError
from deabayes.records.record import VARIABLE, locate, roots
from deabayes.records.schema import read_yaml
from deabayes.records.specimen import FILE

REGISTRY_LINE = re.compile(r"(\S.*?)\s+([0-9a-fA-F]{64})(?:\s+(\S.*))?")


class PublicRecord(NamedTuple):
    """A record of a registry: its SHA-256, and its path below `download.base_url`."""

    sha256: str
    source: str


def read_registry(path: Path) -> dict[str, PublicRecord]:
    """Read records by path from lines ``path sha256 [path at the source]``.

    Paths may contain spaces.

    Raises
    ------
    UserError : the file is missing, or a line has another form.
    """
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; correct download.registry in {FILE}")
    registry = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        match = REGISTRY_LINE.fullmatch(line.strip())
        if match is None:
            raise UserError(
                f"{path}, line {number}: expected 'path sha256', with the path at the source after "
                f"it where that differs; found {line[:60]!r}"
            )
        name, digest, source = match.groups()
        registry[name] = PublicRecord(digest.lower(), source or name)
    return registry


def missing_data(folder: Path, data_root: Path | None = None) -> str | None:
    """Say that a study's public data are missing, and what to do; None if they are here."""
    download = _download(folder)
    if download is None:
        return None
    registry = read_registry(Path(folder) / download["registry"])
    missing = [r for r in registry if locate(r, Path(folder), download, data_root) is None]
    return missing_sentence(folder, download, missing, len(registry)) if missing else None


def missing_sentence(
    folder: Path, download: Mapping[str, str], missing: Iterable[str], total: int
) -> str:
    """The sentence of `missing_data` for the `missing` records."""
    missing = list(missing)
    stated = os.environ.get(VARIABLE)
    wrong = stated and not (Path(stated) / download["folder"]).is_dir()
    found = f" (now it is {stated}, which does not)" if wrong else ""
    return (
        f"{folder}: {len(missing)} of {total} public records are not on this machine (first: "
        f"{missing[0]}); run `make data` to fetch them, or set {VARIABLE} to the folder that "
        f"holds {download['folder']}/{found}"
    )


def fetch(folder: Path, data_root: Path | None = None, progress: bool = False) -> Path:
    """Make a study's public records available and return their folder.

    Records in a local copy ($DEABAYES_DATA or `data_root`) are used unchanged. Otherwise they
    are downloaded into pooch's cache and checked against the registry.

    Raises
    ------
    UserError : no network, a changed file, or a registry that cannot be read.
    """
    download = _download(folder)
    if download is None:
        return Path(folder)
    registry = read_registry(Path(folder) / download["registry"])
    for place in [Path(folder), *roots(download, data_root)[:-1]]:
        if all((place / record).is_file() for record in registry):
            return place
    target = roots(download)[-1]
    _fetch_into(target, download, registry, progress)
    return target


def _fetch_into(
    target: Path, download: Mapping[str, str], registry: Mapping[str, PublicRecord], progress: bool
) -> None:
    import pooch

    base = download["base_url"].rstrip("/") + "/"
    source = pooch.create(
        target,
        base,
        registry={record: f"sha256:{known.sha256}" for record, known in registry.items()},
        urls={record: base + quote(known.source) for record, known in registry.items()},
    )
    pooch.get_logger().setLevel("WARNING")
    for record, known in registry.items():
        try:
            source.fetch(record, progressbar=progress)
        except ValueError:
            raise UserError(
                f"{base}{known.source}: is not the file this project was made with (its SHA-256 "
                "differs); fetch it again, or report that the source has changed"
            ) from None
        except OSError as error:
            raise UserError(
                f"{base}{known.source}: cannot be downloaded ({type(error).__name__}); check the "
                f"network, or set {VARIABLE} to a folder that holds {download['folder']}/"
            ) from None


def _download(folder: Path) -> Mapping[str, str] | None:
    """Return the `download` block of specimen.yaml, even if other parts have faults."""
    download = read_yaml(Path(folder) / FILE).get("download")
    if not isinstance(download, Mapping):
        return None
    if not all(isinstance(download.get(key), str) for key in ("folder", "base_url", "registry")):
        return None  # the schema check of specimen.yaml says what is missing
    return download
