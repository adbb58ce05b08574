"""Records that a posterior was fitted to, and checks that no record counts twice."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr

from deabayes.experiment import Experiment, FloatArray
from deabayes.faults import Faults

ATTRIBUTE = "counted_records"


@dataclass(frozen=True)
class CountedRecord:
    """A calibration record of `study`, identified by checksums of its file and prepared points.

    An unknown checksum is empty.
    """

    study: str
    name: str
    response_name: str
    record_sha256: str = ""
    points_sha256: str = ""

    @classmethod
    def of(cls, study: str, experiment: Experiment) -> CountedRecord:
        """Return the counted record of a prepared record."""
        points = _sum(experiment.coordinate, experiment.response)
        return cls(
            study, experiment.name, experiment.response_name, experiment.record_sha256, points
        )

    def is_same(self, other: CountedRecord) -> bool:
        """Whether both records are the same measurement, even under different names."""
        if self.response_name != other.response_name:
            return False
        pairs = (
            (self.record_sha256, other.record_sha256),
            (self.points_sha256, other.points_sha256),
        )
        return any(one and one == another for one, another in pairs)


def counted_records(tree: xr.DataTree) -> tuple[CountedRecord, ...]:
    """Return the records that the draws of a posterior file already use.

    An older file without this attribute gives only its own records, identified by their points.
    """
    if ATTRIBUTE in tree.attrs:
        return tuple(CountedRecord(**record) for record in json.loads(tree.attrs[ATTRIBUTE]))
    if "observed_data" not in tree.children:
        return ()
    observed, study = tree["observed_data"].to_dataset(), tree.attrs["study_name"]
    return tuple(
        CountedRecord(
            study,
            record["name"],
            record["response_name"],
            points_sha256=_sum(
                observed[f"{record['name']}_coordinate"].values, observed[record["name"]].values
            ),
        )
        for record in json.loads(tree.attrs["experiments"])
    )


def to_json(records: Sequence[CountedRecord]) -> str:
    """Return the attribute of a posterior file as JSON, with every record once."""
    return json.dumps([asdict(record) for record in dict.fromkeys(records)])


def counted_twice(
    study: str, own: Sequence[CountedRecord], known: Sequence[CountedRecord], source: str
) -> list[str]:
    """Return one sentence per own record of a study that the posterior `source` already uses."""
    repeated = []
    for record in own:
        before = next((other for other in known if other.is_same(record)), None)
        if before is not None:
            named = "" if before.name == record.name else f" (there {before.name})"
            repeated.append(
                f"study {study}, prior_from: record {record.name} was fitted in study "
                f"{before.study}{named}, and {source} already uses it, so it would count twice; "
                "remove it from `calibrate`, or remove `prior_from`"
            )
    return repeated


def refuse_counted_twice(
    study: str, experiments: Sequence[Experiment], known: Sequence[CountedRecord], source: str
) -> None:
    """Refuse calibration records that the prior of their study already uses.

    Raises
    ------
    Faults : one for each such record.
    """
    own = [CountedRecord.of(study, e) for e in experiments if e.role == "calibrate"]
    if repeated := counted_twice(study, own, known, source):
        raise Faults(repeated)


def _sum(*arrays: FloatArray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


ROUNDING = 1e-9
"""Tolerance as a share of a channel's largest value; two machines differ by less."""


def check_fitted_records(tree: xr.DataTree, experiments: Sequence[Experiment]) -> None:
    """Refuse calibration records that differ from those of the fit.

    Held-out records are ignored. A population's posterior has no records of its own and is not
    checked.

    Raises
    ------
    Faults : one for each record that was added, removed or changed since the fit.
    """
    if "observed_data" not in tree.children:
        return
    observed = tree["observed_data"].to_dataset()
    calibrated = {e.name: e for e in experiments if e.role == "calibrate"}
    remembered = {record["name"]: record for record in json.loads(tree.attrs["experiments"])}
    changes = [f"{n} was added to the calibration records" for n in calibrated if n not in observed]
    changes += [f"{n} is no calibration record any more" for n in observed if n not in calibrated]
    changes += [
        f"{name} has changed"
        for name, experiment in calibrated.items()
        if name in observed and not _is_same(experiment, observed, remembered[name])
    ]
    if changes:
        study, candidate = tree.attrs["study_name"], tree.attrs["candidate"]
        todo = f"fit again (`deabayes fit {study} {candidate}`, or `snakemake --cores 2`)"
        where = f"study {study}, {candidate}: since the fit, record"
        raise Faults([f"{where} {change}; {todo}" for change in changes])


def _is_same(experiment: Experiment, observed: xr.Dataset, record: dict[str, object]) -> bool:
    """Whether a record's points and excitation agree with those that a posterior file stores."""
    driven, conditions = experiment.excitation, record.get("conditions")
    return (
        _near(observed[experiment.name].values, experiment.response)
        and _near(observed[f"{experiment.name}_coordinate"].values, experiment.coordinate)
        and record["excitation_name"] == driven.name
        and _near(
            np.array([record["lowest"], record["highest"]], dtype=float),
            np.array([driven.values.min(), driven.values.max()]),
        )
        and (conditions is None or conditions == dict(driven.conditions))
    )


def _near(one: FloatArray, other: FloatArray) -> bool:
    if one.shape != other.shape:
        return False
    return bool(np.allclose(one, other, rtol=0.0, atol=ROUNDING * np.abs(one).max(initial=0.0)))
