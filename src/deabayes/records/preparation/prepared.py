"""Prepared records as netCDF files with units, settings and the raw file's hash."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Nodes
from deabayes.faults import UserError
from deabayes.files import write_netcdf_atomically
from deabayes.records.columns import RawRecord
from deabayes.records.preparation.excitation import polyline
from deabayes.records.preparation.working import EXCITATION_COLUMN, BoolArray, IntArray

if TYPE_CHECKING:
    import h5py
    import xarray as xr

LIMIT = 2000
NOISE_FRACTION = 0.01


def thinned(
    coordinate: FloatArray,
    response: FloatArray,
    excitation: FloatArray,
    masked: BoolArray,
    limit: int = LIMIT,
) -> IntArray:
    """Return the indices of at most `limit` samples that plot like the full record (M,).

    Each bin keeps its smallest and its largest response; masked and visible samples are binned
    separately. The bins divide equally the sum of duration, path of the excitation and path of
    the response. A two-second ramp before half an hour of hold therefore stays visible.
    """
    size = coordinate.size
    if size <= limit:
        return np.arange(size)
    run = np.concatenate([[0], np.cumsum(np.diff(masked.astype(int)) != 0)])
    bins = max((limit - 2 * (int(run[-1]) + 1)) // 2, 1)
    position = coordinate / float(np.ptp(coordinate) or 1.0)
    position = position + path(coordinate, excitation) + path(coordinate, response)
    position = (position - position[0]) / (position[-1] - position[0])
    label = np.minimum((position * bins).astype(int), bins - 1)
    group = np.concatenate([[0], np.cumsum((np.diff(label) != 0) | (np.diff(run) != 0))])
    order = np.lexsort((response, group))
    starts = np.flatnonzero(np.concatenate([[True], np.diff(group) != 0]))
    ends = np.concatenate([starts[1:], [size]]) - 1
    return np.unique(np.concatenate([order[starts], order[ends]]))[:limit]


def path(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Share of its path that a channel has travelled up to each sample (M,), without noise.

    Zero for a constant channel and for a coordinate that does not increase everywhere.
    """
    size = float(np.ptp(values))
    if size == 0.0 or np.any(np.diff(coordinate) <= 0.0):
        return np.zeros(coordinate.size)
    knots = polyline(coordinate, values, NOISE_FRACTION * size)
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values[knots])))])
    return np.interp(coordinate, coordinate[knots], gone / gone[-1])


TEXTS = ("name", "protocol", "role", "coordinate_name", "response_name", "provenance")
REQUIRED = {"coordinate", "response", "excitation"}


@dataclass(frozen=True)
class RawOverview:
    """At most 2000 samples (R,) of the raw record, with extremes and masked flags."""

    coordinate: FloatArray
    response: FloatArray
    excitation: FloatArray
    masked: BoolArray


def write_prepared(experiment: Experiment, path: Path, raw: RawRecord | None = None) -> None:
    """Write a prepared record; an interrupted job leaves no half-written file.

    Parameters
    ----------
    experiment : the prepared record; `read_prepared` returns it unchanged.
    raw : the raw record; a thinned copy is stored for the before/after figure.
    """
    dataset = to_dataset(experiment, raw)
    write_netcdf_atomically(dataset, path)


def to_dataset(experiment: Experiment, raw: RawRecord | None = None) -> xr.Dataset:
    """Dataset of a prepared record; dimensions `observation`, `node`, `knot`, `raw_sample`."""
    import xarray as xr

    coordinate, excitation = experiment.coordinate_unit, experiment.excitation
    variables: dict[str, Any] = {
        "coordinate": _variable("observation", experiment.coordinate, coordinate),
        "response": _variable("observation", experiment.response, experiment.response_unit),
        "samples_averaged": _variable("observation", experiment.samples_averaged, "1"),
        "excitation_coordinate": _variable("knot", excitation.coordinate, coordinate),
        "excitation": _variable("knot", excitation.values, excitation.unit),
    }
    if experiment.nodes is not None:
        variables["node_point"] = _variable("node", experiment.nodes.point.astype(float), "1")
        variables["node_offset"] = _variable("node", experiment.nodes.offsets, coordinate)
        variables["node_share"] = _variable("node", experiment.nodes.shares, "1")
    if raw is not None:
        overview = overview_of(experiment, raw)
        variables |= {
            "raw_coordinate": _variable("raw_sample", overview.coordinate, coordinate),
            "raw_response": _variable("raw_sample", overview.response, experiment.response_unit),
            "raw_excitation": _variable("raw_sample", overview.excitation, excitation.unit),
            "raw_masked": _variable("raw_sample", overview.masked.astype(np.int8), "1"),
        }
    attributes = {key: getattr(experiment, key) for key in TEXTS} | {
        "excitation_name": excitation.name,
        "conditions": json.dumps(dict(excitation.conditions)),
        "metadata": json.dumps(dict(experiment.metadata)),
        "steps": json.dumps(list(experiment.steps), default=_plain),
        "warnings": json.dumps(list(experiment.warnings)),
        "record_sha256": experiment.record_sha256,
    }
    return xr.Dataset(variables, attrs=attributes)


def overview_of(experiment: Experiment, raw: RawRecord) -> RawOverview:
    """Thin the raw record for plotting, in the order of its coordinate."""
    coordinate = raw.columns[experiment.coordinate_name]
    order = np.argsort(coordinate, kind="stable")
    coordinate = coordinate[order]
    response = raw.columns[experiment.response_name][order]
    driven = str(experiment.metadata.get(EXCITATION_COLUMN, experiment.excitation.name))
    excitation = raw.columns[driven][order]
    masked = np.zeros(coordinate.size, dtype=bool)
    for first, last in masked_intervals(experiment):
        masked |= (coordinate >= first) & (coordinate <= last)
    kept = thinned(coordinate, response, excitation, masked)
    return RawOverview(coordinate[kept], response[kept], excitation[kept], masked[kept])


def masked_intervals(experiment: Experiment) -> list[tuple[float, float]]:
    """Return all intervals that any step masked, on the raw file's coordinate."""
    return [
        (float(first), float(last))
        for step in experiment.steps
        for first, last in step.get("masked", ())  # type: ignore[attr-defined]
    ]


def read_prepared(path: Path) -> Experiment:
    """Read a file of `write_prepared`; the experiment is bit-for-bit the same."""
    with _opened(Path(path)) as file:
        attributes = file.attrs
        units = {name: file[name].attrs["units"] for name in REQUIRED}
        return Experiment(
            **{key: str(attributes[key]) for key in TEXTS},  # type: ignore[arg-type]
            coordinate_unit=units["coordinate"],
            coordinate=file["coordinate"][()],
            response_unit=units["response"],
            response=file["response"][()],
            samples_averaged=file["samples_averaged"][()],
            excitation=Excitation(
                name=str(attributes["excitation_name"]),
                unit=units["excitation"],
                coordinate=file["excitation_coordinate"][()],
                values=file["excitation"][()],
                conditions=json.loads(attributes["conditions"]),
                noisy=True,
            ),
            nodes=_nodes(file),
            metadata=json.loads(attributes["metadata"]),
            record_sha256=str(attributes["record_sha256"]),
            steps=tuple(json.loads(attributes["steps"])),
            warnings=tuple(json.loads(attributes["warnings"])),
        )


def _nodes(file: h5py.File) -> Nodes | None:
    if "node_offset" not in file:
        return None
    return Nodes(
        file["node_point"][()].astype(np.intp), file["node_offset"][()], file["node_share"][()]
    )


def read_overview(path: Path) -> RawOverview | None:
    """Return the thinned raw record of a prepared file; None if the file has none."""
    with _opened(Path(path)) as file:
        if "raw_response" not in file:
            return None
        return RawOverview(
            coordinate=file["raw_coordinate"][()],
            response=file["raw_response"][()],
            excitation=file["raw_excitation"][()],
            masked=file["raw_masked"][()].astype(bool),
        )


def _opened(path: Path) -> h5py.File:
    """Open a prepared file with h5py, ten times as fast as xarray."""
    import h5py

    if not path.is_file():
        raise UserError(f"{path}: no such prepared record; run `deabayes prepare` first")
    try:
        file = h5py.File(path)
    except OSError as error:
        raise UserError(f"{path}: not a readable netCDF file ({error}); prepare again") from error
    missing = REQUIRED - set(file)
    if missing:
        file.close()
        raise UserError(f"{path}: no prepared record (without {', '.join(sorted(missing))})")
    return file


def _variable(dimension: str, values: FloatArray, unit: str) -> tuple[str, Any, Mapping[str, str]]:
    return (dimension, np.asarray(values), {"units": unit})


def _plain(value: object) -> object:
    """Convert numpy scalars to Python scalars for JSON."""
    return value.item() if isinstance(value, np.generic) else str(value)
