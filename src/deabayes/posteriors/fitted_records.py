"""Whether the records at hand are those that a posterior was fitted to."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from deabayes.experiment import Experiment, FloatArray
from deabayes.faults import Faults

ROUNDING = 1e-9
"""Of a channel's largest value: records prepared on two machines differ by less."""


def check_fitted_records(tree: xr.DataTree, experiments: Sequence[Experiment]) -> None:
    """Refuse records to calibrate on that are not those of the fit, held-out ones aside.

    A population's posterior has no records of its own, and is passed over.

    Raises
    ------
    Faults : each record that was added, taken out or changed since.
    """
    if "observed_data" not in tree.children:
        return
    observed = tree["observed_data"].to_dataset()
    calibrated = {e.name: e for e in experiments if e.role == "calibrate"}
    remembered = {record["name"]: record for record in json.loads(tree.attrs["experiments"])}
    found = [f"{n} is to be calibrated on, and was not" for n in calibrated if n not in observed]
    found += [f"{n} was fitted, and is not at hand" for n in observed if n not in calibrated]
    found += [
        f"{name} is not as it was"
        for name, experiment in calibrated.items()
        if name in observed and not _is_same(experiment, observed, remembered[name])
    ]
    if found:
        study, candidate = tree.attrs["study_name"], tree.attrs["candidate"]
        todo = f"fit again (`deabayes fit {study} {candidate}`, or `snakemake --cores 2`)"
        raise Faults([f"study {study}, {candidate}: record {each} at the fit; {todo}"
                      for each in found])  # fmt: skip


def _is_same(experiment: Experiment, observed: xr.Dataset, record: dict[str, object]) -> bool:
    """The record's points, and of its excitation what a posterior file remembers."""
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
