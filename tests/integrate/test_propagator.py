import numpy as np
import pytest
from scipy.linalg import expm

from deabayes.integrate.state_space import fill_propagator


def propagators(a, b, length):
    size = len(b)
    step, drive = np.empty((size, size)), np.empty((size, 3))
    fill_propagator(a, b, length, np.empty((2, size, size + 1)), step, drive)
    return step, drive


def exponential(a, b, length):
    """The same from the exponential of A with the input's w, w', w'' / 2 as further states."""
    size = len(b)
    whole = np.zeros((size + 3, size + 3))
    whole[:size, :size], whole[:size, size] = a * length, b * length
    whole[size, size + 1], whole[size + 1, size + 2] = 1.0, 2.0
    found = expm(whole)[:size]
    return found[:, :size], found[:, size:]


@pytest.mark.parametrize("norm", [1e-3, 0.3, 0.499, 0.501, 1.0, 7.0, 30.0])
def test_against_the_exponential_of_the_extended_system(norm):
    rng = np.random.default_rng(3)
    a, b = -rng.uniform(0.5, 1.0, (4, 4)), rng.standard_normal(4)  # as large as its norm
    length = norm / np.abs(a).sum(axis=1).max()
    step, drive = propagators(a, b, length)
    found = np.eye(4) + step, drive
    for part, reference in zip(found, exponential(a, b, length), strict=True):
        np.testing.assert_allclose(part, reference, rtol=0.0, atol=3e-14 * np.abs(reference).max())


def test_a_slow_state_beside_a_fast_one_keeps_its_relative_accuracy():
    rates, length = np.array([1e-9, 1e4]), 0.01
    step, drive = propagators(np.diag(-rates), np.ones(2), length)
    assert np.diag(step) == pytest.approx(np.expm1(-rates * length), rel=1e-13)
    assert drive[:, 0] == pytest.approx(-np.expm1(-rates * length) / rates, rel=1e-13)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_what_has_no_exponential_is_nan(bad):
    a = np.array([[-1.0, 0.0], [bad, -1.0]])
    step, drive = propagators(a, np.ones(2), 0.1)
    assert np.isnan(step).all() and np.isnan(drive).all()
