"""What is to be studied: a specimen, its candidates, and how they are judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

Settings = Mapping[str, object]


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
    preparation: Mapping[str, Sequence[Mapping[str, Settings]]] = field(default_factory=dict)
    priors: Mapping[str, Settings] = field(default_factory=dict)
    prior_from: str | None = None
    select: Mapping[str, str] = field(default_factory=dict)
    """Keep only the experiments whose metadata column equals the value (from `split_by`)."""
    data_root: Path | None = None
    """Local copy of the public data sets; else the environment variable DEABAYES_DATA."""
    sampling: Sampling = field(default_factory=Sampling)
