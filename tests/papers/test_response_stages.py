"""Two records that step to one voltage: each keeps its own stages."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from matplotlib import pyplot

from deabayes.experiment import Excitation, Experiment
from deabayes.papers.membrane import response_stages

TIME = np.array([0.5, 1.0, 30.0, 100.0])


def record(name, *shares):
    """A step to 4 kV that has gone these shares of its last millimetre."""
    return Experiment(
        name, "step", "calibrate", "time", "s", TIME, "displacement", "m",
        1e-3 * np.array([*shares, 1.0]), np.ones(4),
        Excitation("voltage", "V", np.array([0.0, 100.0]), np.array([4e3, 4e3])),
    )  # fmt: skip


def test_steps_to_one_voltage_are_told_apart():
    first, again = record("first", 0.1, 0.2, 0.5), record("again", 0.2, 0.6, 0.7)
    fitted = SimpleNamespace(system=SimpleNamespace(order=1), converged=True)
    context = SimpleNamespace(
        candidates={"kv_gm_1": fitted},
        records=lambda *names: [first, again],
        responses=lambda name, each: np.tile(each.response, (5, 1)),
    )
    found = response_stages.compute(context)
    stages = found.tables["stages"].set_index("experiment")
    for each, gained in ((first, [20.0, 30.0, 50.0]), (again, [60.0, 10.0, 30.0])):
        np.testing.assert_allclose(stages.loc[each.name, "measured_percent"], gained)
        np.testing.assert_allclose(stages.loc[each.name, "predicted_percent"], gained)
    (sheet,) = response_stages.draw(None, found)
    bars = [[bar.get_height() for bar in ax.patches] for ax in sheet.axes[2:]]
    np.testing.assert_allclose(bars, [[20.0, 30.0, 50.0], [60.0, 10.0, 30.0]])
    pyplot.close(sheet)
