"""The step of an excitation, and the logarithmic time axes that begin there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from tests.shared.membranes import sine, voltage

from deabayes.experiment import Excitation
from deabayes.figures import panels
from deabayes.figures.record import Record

STRETCHED = Excitation("stretch", "1", np.array([0.0, 2.0, 300.0]), np.array([1.0, 3.0, 3.0]))


@pytest.mark.parametrize(
    ("driven", "at"),
    [
        (voltage([0.0, 4.9, 5.0, 5.3, 600.0], [0.3, -0.3, 0.2, 4000.0, 4000.3]), 5.0),
        (voltage([0.0, 5.0, 5.0001, 600.0], [0.0, 0.0, -2e3, -2e3]), 5.0),
        (voltage([3.0, 600.0], [2e3, 2001.0]), 3.0),  # a constant voltage was off before
        (voltage([0.0, 5.0, 5.1, 5.2, 600.0], [0.0, 0.0, 2.2e3, 2e3, 2e3]), 5.0),  # overshoot
        (voltage([0.0, 5.0, 5.1, 600.0], [3e3, 3e3, 1e3, 1e3]), np.nan),  # it was on before
        (voltage([0.0, 5.0, 5.1, 600.0], [1e3, 1e3, 3e3, 3e3], prehistory="equilibrium"), 5.0),
        (STRETCHED, 0.0),
    ],
)
def test_a_step_is_found(driven, at):
    assert driven.step == pytest.approx(at, nan_ok=True)


@pytest.mark.parametrize(
    "driven",
    [
        voltage([0.0, 5.0, 5.1, 100.0, 100.1, 600.0], [0.0, 0.0, 1e3, 1e3, 2e3, 2e3]),
        voltage([0.0, 5.0, 5.1, 7.0, 7.1, 600.0], [0.0, 0.0, 4e3, 4e3, 0.0, 0.0]),
        voltage([0.0, 5.0, 5.1, 7.0, 7.1, 600.0], [0.0, 0.0, 4e3, 4e3, 2e3, 2e3]),
        voltage([0.0, 500.0, 600.0], [0.0, 2e3, 2e3]),
        voltage([0.0, 600.0], [0.0, 0.0]),
        sine(0.05),
        replace(STRETCHED, values=np.full(3, 2.0)),
        Excitation("displacement", "m", np.array([0.0, 0.1]), np.array([0.0, 0.1]), in_time=False),
    ],
    ids=["two", "pulse", "two levels", "ramp", "none", "sine", "constant", "without time"],
)
def test_other_excitations_have_no_step(driven):
    assert np.isnan(driven.step)


def record(time, step, **attributes):
    flat = ("coordinate", np.ones(len(time)), {"units": "V"})
    kept = {"experiment": "a", "protocol": "step", "role": "validate", "step": step}
    coordinate = ("coordinate", np.asarray(time, float), {"name": "time", "units": "s"})
    return Record(xr.Dataset({"excitation": flat}, {"coordinate": coordinate}, kept | attributes))


def test_a_logarithmic_axis_begins_at_the_step_and_not_at_the_recording():
    time = [0.0, 2.0, 4.0, 5.0, 5.5, 6.0, 10.0, 100.0, 605.0]
    axis = record(time, 5.0).against_coordinate()
    assert axis.logarithmic and axis.label == "time since the step (s)"
    np.testing.assert_allclose(axis.values, [0.5, 1.0, 5.0, 95.0, 600.0])
    panel = Figure().subplots()
    panels.set_horizontal(panel, axis)
    panels.title(panel, record(time, 5.0))
    assert panel.get_xscale() == "log" and "last" not in panel.texts[0].get_text()


def test_a_reading_at_the_step_does_not_stretch_the_axis():
    axis = record([5.0 + 1e-9, 5.5, 6.0, 605.0], 5.0).against_coordinate()
    assert axis.values.min() == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("time", "step", "attributes"),
    [
        (np.geomspace(1.0, 600.0, 50), np.nan, {}),  # several steps, or none
        (np.linspace(150.0, 200.0, 50), 2.0, {}),  # read long after the step
        (np.linspace(0.1, 600.0, 50), 0.0, {"protocol": "sine"}),  # a little sine on a bias
        ([0.0, 1.0], 2.0, {}),
    ],
)
def test_other_records_stay_on_linear_time(time, step, attributes):
    shown = record(time, step, **attributes)
    axis = shown.against_coordinate()
    assert not axis.logarithmic and axis.label == "time (s)"
    np.testing.assert_array_equal(axis.values, time)


def test_predictions_of_older_versions_do_not_know_their_step():
    older = record(np.geomspace(1.0, 600.0, 50), 0.0)
    del older.prediction.attrs["step"]
    assert not older.against_coordinate().logarithmic
