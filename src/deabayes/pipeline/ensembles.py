"""The ensembles that a pool is given: of its posterior, and each one once."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import UserError

if TYPE_CHECKING:
    from deabayes.experiment import FloatArray
    from deabayes.posterior import LogPosterior
    from deabayes.sampling.coordinates import Coordinates
    from deabayes.sampling.ensemble import Ensemble

SAME = 1e-2
"""Nats that a stored density may be off by on another machine, and 1e-9 of its size."""


def read_ensembles(
    target: LogPosterior, paths: Sequence[Path], coordinates: Coordinates
) -> list[Ensemble]:
    """The ensembles in files.

    Raises
    ------
    UserError
        One of another posterior (sampled before a prior or a record was edited, say), or one
        given twice: it would agree with itself.
    """
    from deabayes.sampling.ensemble import Ensemble

    ensembles = [Ensemble.read(path, coordinates) for path in paths]
    first: dict[bytes, Path] = {}
    for path, ensemble in zip(paths, ensembles, strict=True):
        last = ensemble.chain[-1]
        if last.shape[1] != target.dimension or not _same(target(last), ensemble.log_posterior[-1]):
            raise UserError(
                f"{path}: is an ensemble of another posterior than this study and candidate have "
                "now; sample it again with `deabayes fit`"
            )
        known = first.setdefault(last.tobytes(), path)
        if known != path or paths.count(path) > 1:
            raise UserError(
                f"{path}: holds the same draws as {known}; give ensembles of other numbers "
                "(`deabayes fit --ensemble`)"
            )
    return ensembles


def _same(found: FloatArray, stored: FloatArray) -> bool:
    return bool(np.allclose(found, stored, rtol=1e-9, atol=SAME))


def key_of(ensembles: Sequence[Ensemble]) -> str:
    """Name of the checkpoints of a pool of these, in this order."""
    digest = hashlib.sha256()
    for ensemble in ensembles:
        digest.update(hashlib.sha256(ensemble.chain[-1].tobytes()).digest())
    return f"pool_{digest.hexdigest()[:16]}"
