"""The log-posterior of stored draws is of the specimen they were fitted to, wherever they lie."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.test_predict_with import STUDY, creep, file, target

from deabayes.pipeline.identify import stored_target
from deabayes.preparation.prepared import write_prepared


def test_the_specimen_is_the_posterior_files_not_the_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder is elsewhere, or edited since."""
    study = replace(STUDY, specimen=Path("not/here"))
    monkeypatch.chdir(tmp_path)
    write_prepared(creep(), tmp_path / "creep.nc")
    _, found = stored_target(file(None, study), tmp_path)
    z = 0.1 * np.random.default_rng(1).standard_normal((5, target().dimension))
    np.testing.assert_allclose(found(z), target()(z), rtol=1e-12)
