"""The settings of one study: specimen, candidates, records, noise, priors and sampling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from deabayes.faults import UserError

Settings = Mapping[str, object]
AFTER_THE_FIT = ("further_experiments", "evidence_check")
"""Settings that the workflow's study.yaml leaves out; later stages get them from the config."""
OF_OTHER_FITS = ("candidates", "validate")
"""Settings on which the fit of a candidate does not depend; editing them repeats no fit."""


@dataclass(frozen=True)
class Sampling:
    """Size and length of the sampling, and the limits for convergence."""

    ensembles: int = 4
    walkers: int = 32
    max_steps: int = 20000
    ess: float = 400.0
    r_hat: float = 1.01
    autocorrelation_times: float = 10.0
    particles: int = 512
    seed: int = 1

    def __post_init__(self) -> None:
        for setting in fields(self):  # YAML and its schema take 4.0 for a whole number
            if setting.type == "int":
                object.__setattr__(self, setting.name, int(getattr(self, setting.name)))


@dataclass(frozen=True)
class Study:
    """One entry of `studies:` in config.yaml, with its sampling settings."""

    name: str
    specimen: Path
    candidates: tuple[str, ...]
    calibrate: tuple[str, ...] | None = None
    validate: tuple[str, ...] | None = None
    noise: str = "ornstein_uhlenbeck"
    noise_scale: Literal["mixed", "absolute", "range"] = "mixed"
    noise_groups: Literal["protocol", "experiment"] = "protocol"
    noise_coordinate: Literal["record", "grid"] = "record"
    preparation: Mapping[str, Sequence[Mapping[str, Settings]]] = field(default_factory=dict)
    priors: Mapping[str, Settings] = field(default_factory=dict)
    prior_from: str | None = None
    predict_with: Mapping[str, str] = field(default_factory=dict)
    """Protocol -> ending of the candidate that predicts held-out records of it (`_inertia`)."""
    select: Mapping[str, str] = field(default_factory=dict)
    """Keep only the experiments whose column equals the value (from `split_by`)."""
    further_experiments: Mapping[str, Settings] = field(default_factory=dict)
    """Possible next experiments, each like a record of the study except for some factors."""
    evidence_check: Literal["nested"] | None = None
    """A second estimate of the evidence, by nested sampling."""
    model: Path | None = None
    """The user's file that defines the specimen's system, if it is no built-in system."""
    data_root: Path | None = None
    """Local copy of the public data sets; by default the environment variable DEABAYES_DATA."""
    sampling: Sampling = field(default_factory=Sampling)


def to_settings(study: Study) -> dict[str, Any]:
    """Return the study as lists, mappings, texts and numbers for YAML or JSON."""
    settings: dict[str, Any] = _plain(asdict(study))
    return settings


def settings_on_file(study: Study) -> dict[str, Any]:
    """Return the settings of the workflow's study.yaml."""
    return {key: v for key, v in to_settings(study).items() if key not in AFTER_THE_FIT}


def fit_settings(study: Study) -> dict[str, Any]:
    """Return the settings on which the fit of a candidate depends."""
    return {key: v for key, v in settings_on_file(study).items() if key not in OF_OTHER_FITS}


def from_settings(settings: Mapping[str, Any]) -> Study:
    """Create a study from the output of `to_settings`, or from a config entry plus its `name`."""
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
            f"{', '.join(sorted(both))} is listed under calibrate and under validate, but a "
            "held-out record must not be fitted; remove it from one of them"
        )
    return study


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value
