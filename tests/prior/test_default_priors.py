"""Default priors of relaxation times begin at the fastest unit that the records can show."""

import numpy as np
import pytest
from tests.shared.tubes import QUANTITIES

from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.inference.default_priors import adapted_to_records
from deabayes.systems import build

STEP = np.array([0.0, 1.0, 1.001, 20.0]), np.array([0.0, 0.0, 2e3, 2e3])
SINE = np.arange(0.0, 20.0, 0.1), 2e3 * np.sin(np.arange(0.0, 20.0, 0.1)) ** 2


def shortest(time, knots, volts):
    """Lower bound of the default prior of tau_1, given one record."""
    excitation = Excitation("voltage", "V", np.asarray(knots), np.asarray(volts))
    record = Experiment(
        "creep", "creep", "calibrate", "time", "s", time, "strain", "1",
        np.linspace(0.01, 0.02, time.size), np.ones(time.size), excitation,
    )  # fmt: skip
    system = build("tubular", "voigt_kelvin_1", Specimen("tube", "tubular", {}, QUANTITIES))
    parameters = adapted_to_records(system.parameters(), system, [record], {})
    return next(p for p in parameters if p.name == "tau_1").prior.lower


@pytest.mark.parametrize(
    ("time", "excitation", "lower"),
    [
        (np.arange(0.0, 20.0, 0.05), STEP, 0.05),  # the interval; a point comes 49 ms later
        (1.0 + np.geomspace(0.401, 19.0, 200), STEP, 0.1),  # a quarter of the delay
        (1.0 + np.linspace(0.101, 19.0, 200), STEP, 0.095),  # the interval is longer
        (np.arange(10.0, 20.0, 0.03), SINE, 0.03),  # the excitation changes all the time
        (np.geomspace(0.4, 20.0, 200), ([0.0, 20.0], [2e3, 2e3]), 0.1),  # applied from the start
        (np.array([8.0]), ([0.0, 20.0], [2e3, 2e3]), 8.0),  # one point
    ],
)  # fmt: skip
def test_the_shortest_time_is_the_first_that_a_record_can_show(time, excitation, lower):
    assert shortest(time, *excitation) == pytest.approx(lower, rel=0.01)
