"""Posterior files: an ArviZ DataTree on disk, with everything needed to use it again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import asdict
from numbers import Integral
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray

import deabayes
from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.files import write_netcdf_atomically
from deabayes.records.schema import read_yaml

GROUPS = ("posterior", "summary")
ATTRIBUTES = (
    *("study", "study_name", "candidate", "system", "specimen", "provenance", "noise"),
    *("experiments", "convergence", "deabayes_version"),
)
"""Attributes of every posterior file, also of a population's."""


def write_tree(tree: xr.DataTree, path: Path) -> None:
    """Write a DataTree as netCDF; a killed job leaves no half-written file."""
    write_netcdf_atomically(tree, path)


def write_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a Dataset as netCDF; a killed job leaves no half-written file."""
    write_netcdf_atomically(dataset, path)


def write_datasets(datasets: Mapping[str, xr.Dataset], folder: Path, mark: str) -> None:
    """Write each dataset as `{name}.nc`; remove files of other names from an earlier run.

    Parameters
    ----------
    mark : attribute that marks such files. Other files in the folder are not touched.
    """
    for name, dataset in datasets.items():
        write_dataset(dataset, folder / f"{name}.nc")
    for path in folder.glob("*.nc"):
        if path.stem not in datasets and _has(path, mark):
            path.unlink()


def _has(path: Path, attribute: str) -> bool:
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return attribute in dataset.attrs
    except (OSError, ValueError):  # not a netCDF file
        return False


def read_tree(path: str | Path, groups: Collection[str] | None = None) -> xr.DataTree:
    """Read a posterior file into memory, or raise an error that says what is wrong.

    Parameters
    ----------
    groups : groups to read, all by default; the other groups stay empty.
    """
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{path}: is a folder{_posteriors_in(path)}")
    if not path.is_file():
        raise UserError(
            f"{path}: no such file; fit the candidate first (`snakemake --cores 2`, "
            "or `deabayes fit STUDY CANDIDATE`)"
        )
    try:
        tree = _read(path, groups)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a readable netCDF file ({error}); fit again") from error
    _check_content(tree, path)
    return tree


def _read(path: Path, groups: Collection[str] | None) -> xr.DataTree:
    with h5py.File(path) as file:
        names = [str(name) for name in file if isinstance(file[name], h5py.Group)]
    datasets = {
        name: xr.load_dataset(path, engine="h5netcdf", group=name)
        if groups is None or name in groups
        else xr.Dataset()
        for name in names
    }
    root = xr.load_dataset(path, engine="h5netcdf")
    return xr.DataTree.from_dict({"/": root, **datasets})


def _check_content(tree: xr.DataTree, path: Path) -> None:
    """Refuse files that are no posterior file, or whose specimen this version cannot read."""
    lacking = [f"group {name}" for name in GROUPS if name not in tree.children]
    lacking += [f"attribute {name}" for name in ATTRIBUTES if name not in tree.attrs]
    if lacking:
        missing = "posterior" if "posterior" not in tree.children else ", ".join(lacking[:3])
        raise UserError(f"{path}: holds no {missing}; give a posterior.nc written by deabayes")
    try:
        specimen_from_json(tree.attrs["specimen"])
    except (TypeError, KeyError, ValueError) as error:
        raise UserError(f"{path}: {of_another_version(tree.attrs, 'specimen', error)}") from error


def of_another_version(attributes: Mapping[str, Any], what: str, found: object) -> str:
    """Return the message that another version stored something in a different way."""
    return (
        f"deabayes {deabayes.__version__} cannot read {what} ({found}); the file was written by "
        f"deabayes {attributes['deabayes_version']}: use that version, or fit again"
    )


def _posteriors_in(folder: Path) -> str:
    """Say which posterior files to give instead of a folder of a candidate, study or results."""
    posteriors = sorted(
        file for depth in ("", "*/", "*/*/") for file in folder.glob(f"{depth}posterior.nc")
    )
    if not posteriors:
        return " without a posterior.nc"
    return f"; give {' or '.join(map(str, posteriors[:9]))}"


def picked(total: int, size: int | None, seed: int) -> NDArray[np.intp]:
    """Return which of `total` draws to take: `size` at random, or all in order if None.

    Raises
    ------
    UserError : the size is not a whole number above 0, or the seed is below 0 or not whole.
    """
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise UserError(f"seed must be a whole number, 0 or more; found {seed!r}") from None
    if size is None:
        return np.arange(total)
    if not isinstance(size, Integral) or size < 1:
        raise UserError(f"size must be a whole number above 0, found {size!r}")
    size = int(size)
    return rng.choice(total, size, replace=size > total)


def stacked(group: xr.DataTree, name: str) -> FloatArray:
    """Return a variable of a group as (chain * draw,)."""
    return np.asarray(group[name].values, dtype=float).reshape(-1)


def sum_of_draws(tree: xr.DataTree) -> str:
    """Return a checksum of a posterior's draws, whenever and wherever its file was written.

    The text begins with letters. A table reader could take some sums of hexadecimal digits alone
    for a number.
    """
    group = tree["posterior"]
    digest = hashlib.sha256()
    for name in sorted(map(str, group.data_vars)):
        digest.update(name.encode() + np.ascontiguousarray(group[name], dtype="<f8").tobytes())
    return f"sha256:{digest.hexdigest()[:16]}"


def specimen_to_json(specimen: Specimen) -> str:
    """Return the specimen as JSON, with quantities in SI units."""
    return json.dumps(asdict(specimen))


def specimen_from_json(text: str) -> Specimen:
    """Return the specimen of a text from `specimen_to_json`."""
    content: Mapping[str, Any] = json.loads(text)
    return Specimen(
        name=content["name"],
        system=content["system"],
        provenance=content["provenance"],
        quantities={k: Quantity(**q) for k, q in content["quantities"].items()},
        instruments={k: Quantity(**q) for k, q in content["instruments"].items()},
    )


def fitted_posteriors(results: Path) -> list[Path]:
    """Return `{candidate}/posterior.nc` of each fitted candidate, sorted by name.

    Only candidates listed in study.yaml count. A candidate that was removed from the study keeps
    its folder, but is ignored. Stages that run one by one may not have written study.yaml. Then
    every folder counts.
    """
    posteriors = sorted(results.glob("*/posterior.nc"))
    settings = results / "study.yaml"
    listed = read_yaml(settings).get("candidates") if settings.is_file() else None
    return [path for path in posteriors if listed is None or path.parent.name in listed]
