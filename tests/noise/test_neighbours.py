"""The correlation of neighbouring residuals is that of noise drawn by the noise model."""

import numpy as np
import pandas as pd
import pytest
from tests.validation.neighbours import correlated, lag_one

from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck


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


def test_specimens_are_told_apart_by_their_number():
    numbers = pd.Series([3, 0, 1, 2], index=[7, 8, 9, 10])
    found = correlated(1, numbers)
    assert list(found.index) == [7, 8, 9, 10]
    alone = [correlated(1, numbers[[index]]).item() for index in numbers.index]
    assert list(found) == alone
    assert set(alone) == {True, False}
