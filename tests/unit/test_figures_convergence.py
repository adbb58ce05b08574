"""Runs that are too short are seen in the figure of convergence."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from tests.unit.fake_records import Fake
from tests.unit.fake_results import write_study

from deabayes import figures
from deabayes.figures import style
from deabayes.figures.convergence import run_lengths
from deabayes.figures.results import StudyResults

FAILED = [
    {"gate": "r_hat", "of": "E_0", "badness": 1.3},
    {"gate": "length", "of": "run 2", "badness": -28.0},
]
OLDER = {"failed_gates": FAILED, "autocorrelation_times_min": 28.0}


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
    colours = [to_hex(each) for each in points.get_facecolors()]
    assert colours == [
        (style.BLUE if each >= 50.0 else style.VERMILLION).lower() for each in lengths
    ]
    assert (style.VERMILLION.lower() in colours) is not converged
    assert list(ax.lines[0].get_xdata()) == [50.0, 50.0]
    low, high = ax.get_xlim()
    assert low < min(lengths) and high > max(lengths)


def test_older_files_show_the_runs_of_which_they_know_the_length() -> None:
    assert run_lengths(OLDER | {"autocorrelation_times": [70.0, 28.0]}) == {
        "run 1": 70.0,
        "run 2": 28.0,
    }
    assert run_lengths(OLDER) == {"run 2": 28.0}
    assert run_lengths({"autocorrelation_times_min": 61.0}) == {"shortest run": 61.0}
    assert run_lengths({}) == {}
