"""The ensembles that a pool is given: of its own posterior, and each one once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.test_predict_with import STUDY, UNCERTAIN, creep

from deabayes.faults import UserError
from deabayes.pipeline.ensembles import key_of, read_ensembles
from deabayes.posterior import LogPosterior, build
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.proposal_fit import fit

RECORD = creep()


def target(**changes: object) -> LogPosterior:
    return build(STUDY, "voigt_kelvin_2", UNCERTAIN, [replace(RECORD, **changes)])  # type: ignore[arg-type]


def written(path: Path, of: LogPosterior, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    chain = 0.3 * rng.standard_normal((40, 24, of.dimension))
    log_posterior = np.stack([of(step) for step in chain])
    proposal = fit(chain.reshape(-1, of.dimension), 1, rng)
    Ensemble(chain, log_posterior, proposal, 40, 0, 1, 0.5, 1.0, 0, 960, 0, True).write(path)
    return path


def read(of: LogPosterior, *paths: Path) -> list[Ensemble]:
    return read_ensembles(of, paths, Coordinates())


def test_ensembles_of_this_posterior_are_taken(tmp_path: Path) -> None:
    paths = [written(tmp_path / f"{seed}.nc", target(), seed) for seed in (1, 2)]
    assert len(read(target(), *paths)) == 2


def test_an_ensemble_of_an_edited_record_is_refused(tmp_path: Path) -> None:
    paths = [written(tmp_path / f"{seed}.nc", target(), seed) for seed in (1, 2)]
    with pytest.raises(UserError, match=r"1\.nc: is an ensemble of another posterior"):
        read(target(response=1.01 * RECORD.response), *paths)


def test_an_ensemble_does_not_agree_with_itself(tmp_path: Path) -> None:
    path = written(tmp_path / "1.nc", target(), 1)
    (tmp_path / "2.nc").write_bytes(path.read_bytes())
    for again in (path, tmp_path / "2.nc"):
        with pytest.raises(UserError, match=r"\.nc: holds the same draws as .*1\.nc; give"):
            read(target(), path, again)


def test_checkpoints_of_other_ensembles_and_of_another_order_are_not_resumed(
    tmp_path: Path,
) -> None:
    paths = [written(tmp_path / f"{seed}.nc", target(), seed) for seed in (1, 2, 3)]
    one, two, three = read(target(), *paths)
    names = [key_of(each) for each in ([one, two], [two, one], [one, three], [one, two, three])]
    assert len(set(names)) == 4 and key_of([one, two]) == names[0]
