"""Masks that hide nothing: their times are in another unit, or of another record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deabayes.experiment import Experiment

MASKS = ("mask_before", "mask_after", "mask_between")


def with_idle_masks(experiments: Sequence[Experiment]) -> list[Experiment]:
    """The experiments, the first of a protocol warned of masks without effect on any of it.

    A mask is for all records of its protocol, and some may end before it.
    """
    of: dict[str, list[Experiment]] = {}
    for each in experiments:
        of.setdefault(each.protocol, []).append(each)
    idle = {own[0].name: tuple(_idle_masks(own)) for own in of.values()}
    return [
        replace(each, warnings=(*each.warnings, *idle.get(each.name, ()))) for each in experiments
    ]


def _idle_masks(experiments: Sequence[Experiment]) -> Iterator[str]:
    """A warning per step that hides no sample of these records of one protocol."""
    entries: Any
    for entries in zip(*(each.steps for each in experiments), strict=False):
        step, settings = entries[0]["step"], entries[0]["settings"]
        meant = [each for each in experiments if settings.get("record") in (None, each.name)]
        if step in MASKS and meant and not any(entry["masked"] for entry in entries):
            given = ", ".join(f"{key}: {value}" for key, value in settings.items())
            yield (
                f"step {step} ({given}) hides no sample of {_extent(meant)}; correct its times or "
                "their unit, or remove it"
            )


def _extent(experiments: Sequence[Experiment]) -> str:
    """Which records, and what their points lie between."""
    which = experiments[0].name if len(experiments) == 1 else f"any {experiments[0].protocol}"
    every = np.concatenate([each.coordinate for each in experiments])
    unit = experiments[0].coordinate_unit
    return f"{which} record, from {every.min():.4g} to {every.max():.4g} {unit}"
