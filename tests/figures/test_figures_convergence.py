"""Runs that are too short are seen in the figure of convergence."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures import style
from deabayes.figures.results import StudyResults


@pytest.mark.parametrize("converged", [True, False])
def test_every_run_is_shown_against_the_limit(converged: bool, tmp_path: Path) -> None:
    study = write_study(tmp_path, Fake(candidates=(1,), converged=converged))
    results = StudyResults(study).recommended
    ax = figures.draw("convergence", results)[0].axes[2]
    (points,) = ax.collections
    lengths, rows = np.asarray(points.get_offsets()).T
    np.testing.assert_array_equal(lengths, results.convergence["autocorrelation_times"])
    assert [ax.get_yticklabels()[int(k)].get_text() for k in rows] == [
        f"run {k}" for k in (1, 2, 3, 4)
    ]
    assert min(lengths) < 10.0, "one run alone may be short"
    colours = {to_hex(each) for each in points.get_facecolors()}
    assert colours == {(style.BLUE if converged else style.VERMILLION).lower()}
    assert list(ax.lines[0].get_xdata()) == [10.0, 10.0]
    low, high = ax.get_xlim()
    assert low < min(lengths) and high > max(lengths)
