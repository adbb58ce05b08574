"""A candidate with its posterior draws, rebuilt from a posterior file for predictions."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.faults import UserError, nearest
from deabayes.inference.record_noise import noise_coordinate
from deabayes.noise import REGISTRY as NOISE_MODELS
from deabayes.noise.base import NoiseModel
from deabayes.own_models.loading import restore
from deabayes.posteriors.storage import (
    of_another_version,
    picked,
    specimen_from_json,
    stacked,
)
from deabayes.prediction.bands import Samples, sample_response
from deabayes.prediction.calibrated import Calibrated, CalibratedRecord
from deabayes.prediction.given import excitation_of
from deabayes.prediction.noise_origin import NoiseOrigin, find_noise
from deabayes.prediction.outcomes import Reading
from deabayes.systems import build as build_system
from deabayes.systems.base import System


@dataclass(frozen=True)
class Fitted:
    """A candidate, its noise model and its draws, ready to predict.

    `draws` maps every parameter, noise included, to (S,) values in SI. `predicts_with` maps a
    protocol to the wider system that predicts its records instead of the fitted `system`
    (`predict_with` of a study). `new_specimen` says that the draws describe a new specimen of the
    population, and none of the measured ones.
    """

    candidate: str
    specimen: Specimen
    system: System
    noise: NoiseModel
    noise_scale: str
    noise_along: str
    draws: Mapping[str, FloatArray]
    records: tuple[CalibratedRecord, ...]
    converged: bool
    predicts_with: Mapping[str, System] = field(default_factory=dict)
    new_specimen: bool = False

    @classmethod
    def from_tree(cls, tree: xr.DataTree, size: int | None = None, seed: int = 0) -> Fitted:
        """Rebuild from a posterior file, with `size` random draws or, by default, all draws."""
        restore(tree.attrs)
        specimen = specimen_from_json(tree.attrs["specimen"])
        settings = json.loads(tree.attrs["study"])
        group = tree["posterior"]
        names = [str(n) for n, v in group.data_vars.items() if v.attrs["kind"] != "derived"]
        draws = {name: stacked(group, name) for name in names}
        rows = picked(next(iter(draws.values())).size, size, seed)
        draws = {name: values[rows] for name, values in draws.items()}
        candidate = tree.attrs["candidate"]
        return cls(
            candidate,
            specimen,
            build_system(specimen.system, candidate, specimen),
            _noise_of(tree.attrs),
            settings.get("noise_scale", "absolute"),
            settings.get("noise_coordinate", "record"),
            draws,
            _records_of(tree.attrs),
            json.loads(tree.attrs["convergence"])["converged"],
            {
                protocol: build_system(specimen.system, candidate + ending, specimen)
                for protocol, ending in settings.get("predict_with", {}).items()
            },
            "population" in tree.attrs,
        )

    def has_seen(self, experiment: Experiment) -> bool:
        """Whether the draws were fitted to this record."""
        named = any(record.name == experiment.name for record in self.records)
        return named and not self.new_specimen

    def system_for(self, experiment: Experiment) -> System:
        """Return the forward model of a record.

        This is the fitted model, unless the record is not calibrated and its protocol has a wider
        model.
        """
        if any(record.name == experiment.name for record in self.records):
            return self.system
        return self.predicts_with.get(experiment.protocol, self.system)

    def model_note(self, experiment: Experiment, protocol: str | None) -> str:
        """Say which model solves a prediction; empty if the study has only the fitted model.

        Parameters
        ----------
        protocol : protocol that the user named for the prediction; None without one.
        """
        if protocol in self.predicts_with:
            return f"solved by {self.system_for(experiment).candidate} (predict_with)"
        if protocol is not None or not self.predicts_with:
            return ""
        wider = ", ".join(
            f"records of {name} are predicted with {system.candidate}"
            for name, system in self.predicts_with.items()
        )
        return f"solved by {self.candidate}, the fitted candidate; {wider}: give the protocol"

    def responses(self, experiment: Experiment) -> FloatArray:
        """Return the model's response to a record, (S, N)."""
        return self.system_for(experiment).simulator_of(experiment)(self.draws)

    def noise_of(self, experiment: Experiment) -> NoiseOrigin:
        """Return the origin of the noise that an experiment should have (see `find_noise`)."""
        return find_noise(experiment, self.records, self.system, self.noise_scale, self.noise_along)

    def sample(self, experiment: Experiment, rng: np.random.Generator) -> Samples:
        """Sample the response to an experiment (see `sample_response`)."""
        origin = self.noise_of(experiment)
        return sample_response(
            self.system_for(experiment),
            self.noise,
            self.draws,
            self._noise_draws(origin),
            experiment,
            origin,
            origin.stretch * noise_coordinate(self.noise_along, experiment),
            rng,
            self.has_seen(experiment),
        )

    def reading(self, experiment: Experiment) -> tuple[Reading, NDArray[np.bool_]]:
        """Return the curves and noise law of an experiment, and which draws have a response."""
        curves, origin = self.responses(experiment), self.noise_of(experiment)
        finite = np.all(np.isfinite(curves), axis=1)
        scales = origin.scales(curves)
        if origin.proportional:
            with np.errstate(all="ignore"):
                curves = np.log(curves)
        reading = Reading(
            curves,
            scales,
            self.noise,
            origin.draws(self.noise, self._noise_draws(origin), curves, scales),
            origin.stretch * noise_coordinate(self.noise_along, experiment),
            1.0 / experiment.samples_averaged,
        )
        return reading, finite & np.all(np.isfinite(curves), axis=1) & np.isfinite(scales)

    def _noise_draws(self, origin: NoiseOrigin) -> dict[str, FloatArray]:
        """Return the noise parameters of an origin's group, with names without the prefix."""
        prefix = f"{origin.group}."
        return {n[len(prefix) :]: v for n, v in self.draws.items() if n.startswith(prefix)}

    def extrapolation(self, experiment: Experiment) -> str:
        """Say in which respects an experiment leaves the calibrated region; empty if in none."""
        return Calibrated(self.system, self.records).extrapolation(experiment)

    def unit_note(self, experiment: Experiment) -> str:
        """Say that a voltage may have been given in kV; empty if it is not that small."""
        return Calibrated(self.system, self.records).unit_note(experiment)

    def experiment(
        self,
        channels: Mapping[str, ArrayLike],
        response: str | None,
        conditions: Mapping[str, float | str],
        protocol: str | None = None,
    ) -> Experiment:
        """Build a new experiment from arrays: `time` and one excitation channel."""
        if protocol is not None and protocol not in self.system.protocols:
            raise UserError(
                f"protocol {protocol!r} is unknown{nearest(protocol, self.system.protocols)}"
            )
        given = {name: values for name, values in channels.items() if name != "time"}
        driven, label = excitation_of(self.system, channels.get("time"), given, conditions)
        fitted = [r.response_name for r in self.records if r.excitation_name == driven.name]
        response = response or next(iter(fitted), None) or self.system.response_to(driven.name)
        if response not in self.system.responses:
            raise UserError(
                f"response {response!r} is unknown{nearest(response, self.system.responses)}"
            )
        return Experiment(
            name="prediction",
            protocol=protocol or "prediction",
            role="validate",
            coordinate_name=label,
            coordinate_unit="s" if label == "time" else driven.unit,
            coordinate=driven.coordinate,
            response_name=response,
            response_unit=self.system.responses[response],
            response=np.full(driven.coordinate.size, np.nan),
            samples_averaged=np.ones(driven.coordinate.size),
            excitation=driven,
            provenance=self.specimen.provenance.get("kind", "measured"),
        )


def _noise_of(attributes: Mapping[str, str]) -> NoiseModel:
    """Return the noise model that a posterior file names."""
    name = attributes["noise"]
    if name not in NOISE_MODELS:
        raise UserError(_unreadable(attributes, "the noise model", name))
    model: NoiseModel = NOISE_MODELS[name]()
    return model


def _records_of(attributes: Mapping[str, str]) -> tuple[CalibratedRecord, ...]:
    """Return the calibrated records that a posterior file stores."""
    try:
        return tuple(CalibratedRecord(**record) for record in json.loads(attributes["experiments"]))
    except TypeError as error:  # a key is unknown or missing
        words = str(error).partition("() ")[2]
        raise UserError(_unreadable(attributes, "the list of calibrated records", words)) from error


def _unreadable(attributes: Mapping[str, str], what: str, found: str) -> str:
    where = f"{attributes['study_name']}, {attributes['candidate']}"
    return f"{where}: {of_another_version(attributes, what, found)}"
