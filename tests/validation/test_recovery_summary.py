"""The correlation of neighbouring residuals is that of noise drawn by the noise model."""

import numpy as np
import pytest

from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from tests.validation.recovery_summary import correlated, lag_one


@pytest.mark.parametrize("time", [0.05, 1.0, 30.0])
def test_drawn_residuals_correlate_as_stated(time):
    spaced = np.concatenate([np.full(30, 0.5), np.full(20, 4.0)]).cumsum()
    values = {"sigma_ou": 2.0, "sigma_white": 1.0, "tau_ou": time}
    draws = {name: np.full(4000, value) for name, value in values.items()}
    rng = np.random.default_rng(5)
    parts = OrnsteinUhlenbeck().sample(rng, spaced, np.ones(spaced.size), draws)
    residuals = sum(parts)
    found = (residuals[:, 1:] * residuals[:, :-1]).mean(axis=0) / residuals.var(axis=0).mean()
    truth = {f"step.{name}": np.array([value]) for name, value in values.items()}
    assert found.mean() == pytest.approx(lag_one(truth, spaced), abs=0.01)


def test_a_specimen_depends_on_its_number_only():
    together = correlated(1, [3, 0, 1, 2])
    assert together == [correlated(1, [number])[0] for number in (3, 0, 1, 2)]
    assert set(together) == {True, False}
