"""What parameters do to a sine's cycles, for a response whose loops have a closed form."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtri
from tests.shared.membranes import sine

from deabayes.experiment import Experiment
from deabayes.papers.membrane.influence import cycle_stages, has_cycles
from deabayes.papers.timing import PHASES
from deabayes.prediction.influence import PriorModel, stage_sensitivity
from deabayes.prior.distributions import LogNormal, Uniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter

VOLTS, PERIOD, CYCLES = 2e3, 20.0, 4
MISSED = 1.0 - np.cos(2.0 * np.pi / PHASES)
"""Of an amplitude, at most: a peak of cos 2x lies half a spacing beside the even phases."""
HARDLY = LogNormal(1e-12, 1.0)
SIZE, LAG = LogNormal(1e-3, 0.5), Uniform(0.2, 0.8)


def parameter(name, prior):
    return Parameter(name, name, "1", "", prior, "made up")


class Lagging:
    """u = p [1 - cos(2x - d)]/2 + s t, x the phase of the voltage, sin d = `lag`, s = `creep`.

    Its amplitude is p; the mean rises by s T a cycle; -int u d|V sin x| over both polarities
    is (4/3) p V sin d + (2/pi) s T V. In the first cycle p is a share `first` of itself.
    Draws of p above `most` fail.
    """

    def __init__(self, creep=HARDLY, first=1.0, most=np.inf):
        self.first, self.most = first, most
        self.known = (parameter("size", SIZE), parameter("lag", LAG), parameter("creep", creep))

    def parameters(self):
        return self.known

    def predict(self, excitation, coordinate, response, draws):
        size, lag, creep = (draws[n][:, None] for n in ("size", "lag", "creep"))
        phase = 2.0 * np.pi * np.asarray(coordinate) / PERIOD
        grown = size * np.where(coordinate < 1.5 * PERIOD, self.first, 1.0)
        found = grown * (1.0 - np.cos(2.0 * phase - np.arcsin(lag))) / 2.0 + creep * coordinate
        return np.where(size > self.most, np.nan, found)


def model(periods=CYCLES, **changes):
    system = Lagging(**changes)
    time = np.linspace(0.0, periods * PERIOD, 20 * periods + 1)
    record = Experiment(
        "sine", "sine", "validate", "time", "s", time, "displacement", "m",
        np.zeros(time.size), np.ones(time.size), sine(1.0 / PERIOD, periods, amplitude=VOLTS),
    )  # fmt: skip
    return PriorModel(system, Prior(system.parameters()), record)


def test_stages_are_the_closed_forms():
    about = model(creep=LogNormal(1e-5, 0.3))
    z = np.random.default_rng(1).standard_normal((40, 3))
    size, lag, creep = (about.parameters(z)[name] for name in about.names)
    found = cycle_stages(about, z)
    assert list(found) == [
        "peak to peak, cycle 1", "peak to peak, cycle 4", "drift of the mean, 1 to 4",
        "loop area, cycle 4",
    ]  # fmt: skip
    rise = creep * PERIOD
    np.testing.assert_allclose(found["drift of the mean, 1 to 4"], (CYCLES - 1) * rise, rtol=1e-9)
    area = 4.0 / 3.0 * size * VOLTS * lag + 2.0 / np.pi * rise * VOLTS
    np.testing.assert_allclose(found["loop area, cycle 4"], area, rtol=2e-3)
    still = cycle_stages(model(), z)
    for cycle in (1, 4):
        np.testing.assert_allclose(still[f"peak to peak, cycle {cycle}"], size, rtol=MISSED)


def test_the_first_cycle_is_told_from_the_last():
    about = model(first=0.5)
    z = np.random.default_rng(1).standard_normal((40, 3))
    size, lag = (about.parameters(z)[name] for name in ("size", "lag"))
    found = cycle_stages(about, z)
    np.testing.assert_allclose(found["peak to peak, cycle 1"], 0.5 * size, rtol=MISSED)
    np.testing.assert_allclose(found["peak to peak, cycle 4"], size, rtol=MISSED)
    np.testing.assert_allclose(found["drift of the mean, 1 to 4"], 0.25 * size, rtol=1e-6)
    area = 4.0 / 3.0 * size * VOLTS * lag
    np.testing.assert_allclose(found["loop area, cycle 4"], area, rtol=2e-3)


def relative_variance(prior, region):
    """Variance over squared mean of an independent factor within the central region."""
    u = 0.5 + region * ((np.arange(200_000) + 0.5) / 200_000 - 0.5)
    values = prior.from_normal(ndtri(u))
    return np.var(values) / np.mean(values) ** 2


def test_indices_of_a_product_of_independent_factors():
    """Area = p sin d: S_p = v_p / D, S_Tp = v_p (1 + v_d) / D, D = (1 + v_p)(1 + v_d) - 1."""
    found = stage_sensitivity(model(), cycle_stages, 1024, np.random.default_rng(2))
    assert (found.region, found.failed) == (0.9, 0)
    size, lag = (relative_variance(prior, found.region) for prior in (SIZE, LAG))
    whole = (1.0 + size) * (1.0 + lag) - 1.0
    area = found.by_stage["loop area, cycle 4"]
    np.testing.assert_allclose(area.first_order, np.array([size, lag, 0.0]) / whole, atol=0.01)
    total = np.array([size * (1.0 + lag), lag * (1.0 + size), 0.0]) / whole
    np.testing.assert_allclose(area.total, total, atol=0.01)
    np.testing.assert_allclose(
        found.by_stage["peak to peak, cycle 1"].first_order, [1.0, 0.0, 0.0], atol=0.01
    )
    np.testing.assert_allclose(
        found.by_stage["drift of the mean, 1 to 4"].total, [0.0, 0.0, 1.0], atol=0.01
    )


def test_draws_that_fail_narrow_the_region():
    most = float(SIZE.from_normal(ndtri(np.array(0.9))))
    found = stage_sensitivity(model(most=most), cycle_stages, 128, np.random.default_rng(3))
    assert found.region == pytest.approx(0.8) and found.failed == 0


def test_a_record_that_is_no_sine_of_two_cycles_is_not_asked():
    assert has_cycles(model().experiment)
    assert not has_cycles(model(periods=1).experiment)
    flat = SimpleNamespace(protocol="step")
    assert not has_cycles(flat)
