"""Which posterior files a study's results folder holds."""

from __future__ import annotations

from pathlib import Path

from deabayes.reading.yaml_file import read_yaml


def fitted_posteriors(results: Path) -> list[Path]:
    """`{candidate}/posterior.nc` of each fitted candidate, by name.

    A candidate that has been taken out of the study keeps its folder, and is passed over:
    study.yaml lists those that count. Stages run one by one may have written none, and what
    is there counts.
    """
    found = sorted(results.glob("*/posterior.nc"))
    settings = results / "study.yaml"
    listed = read_yaml(settings).get("candidates") if settings.is_file() else None
    return [path for path in found if listed is None or path.parent.name in listed]
