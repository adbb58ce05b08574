"""The log-posterior of stored draws is of the specimen they were fitted to, wherever they lie."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.posteriors.test_predict_with import STUDY, UNCERTAIN, creep, file, target

from deabayes.faults import UserError
from deabayes.inference.log_posterior import LogPosterior, build
from deabayes.pipeline.fit import stored_target
from deabayes.posteriors.inheritance import GROUP
from deabayes.posteriors.storage import read_tree, write_tree
from deabayes.prior.joint import PriorFromPosterior
from deabayes.records.preparation.prepared import write_prepared

GONE = replace(STUDY, specimen=Path("not/here"), prior_from="gone/posterior.nc")


def bent() -> PriorFromPosterior:
    """Draws that one normal does not describe."""
    moduli = np.exp(np.random.default_rng(2).normal([14.0, 15.0], 0.05, (2000, 2)))
    moduli[::2] *= [1.3, 0.8]
    return PriorFromPosterior(("E_0", "E_1"), moduli)


def z_of(target: LogPosterior) -> np.ndarray:
    return 0.1 * np.random.default_rng(1).standard_normal((5, target.dimension))


def test_the_specimen_comes_from_the_posterior_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder is elsewhere, or edited since."""
    study = replace(STUDY, specimen=Path("not/here"))
    monkeypatch.chdir(tmp_path)
    write_prepared(creep(), tmp_path / "creep.nc")
    _, found = stored_target(file(None, study), tmp_path)
    z = 0.1 * np.random.default_rng(1).standard_normal((5, target().dimension))
    np.testing.assert_allclose(found(z), target()(z), rtol=1e-12)


@pytest.mark.parametrize("counted", [True, False])
def test_an_inherited_prior_comes_from_the_posterior_file(tmp_path: Path, counted: bool) -> None:
    """The folder was moved, and the posterior that became the prior stayed behind."""
    fitted = build(GONE, "voigt_kelvin_2", UNCERTAIN, [creep()], bent(), counted)
    assert fitted.prior.inherited[0].mixture.components > 1
    write_prepared(creep(), tmp_path / "prepared" / "creep.nc")
    write_tree(file(None, GONE, fitted), tmp_path / "posterior.nc")
    _, found = stored_target(read_tree(tmp_path / "posterior.nc"), tmp_path / "prepared")
    z = z_of(fitted)
    np.testing.assert_array_equal(found(z), fitted(z))
    assert found.quantities_counted == counted
    assert found.prior.describe("E_0") == fitted.prior.describe("E_0")


def test_a_prior_only_for_predictions_is_no_prior_of_the_fit(tmp_path: Path) -> None:
    write_prepared(creep(), tmp_path / "prepared" / "creep.nc")
    write_tree(file(None, GONE), tmp_path / "posterior.nc")
    _, found = stored_target(read_tree(tmp_path / "posterior.nc"), tmp_path / "prepared")
    assert found.prior.inherited == ()


def test_an_earlier_file_without_the_prior_it_had_says_what_to_do(tmp_path: Path) -> None:
    write_prepared(creep(), tmp_path / "creep.nc")
    tree = file(None, GONE)
    del tree[GROUP]
    with pytest.raises(UserError, match=r"gone/posterior.nc.*put that file back, or fit"):
        stored_target(tree, tmp_path)
