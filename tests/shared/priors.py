"""Parameters of made-up priors, in ordered groups, products and free; a check of densities."""

import numpy as np
import pytest
from scipy import stats

from deabayes.prior.distributions import LogNormal, LogUniform, Normal, TruncatedNormal, Uniform
from deabayes.prior.parameter import Parameter


def parameter(name, prior, unit="1", **kwargs):
    return Parameter(name, name, unit, "", prior, "test", **kwargs)


def ordered(group, prior, size=3, unit="s", **kwargs):
    numbers = range(1, size + 1)
    return tuple(parameter(f"{group}_{k}", prior, unit, ordered=group, **kwargs) for k in numbers)


TAU = ordered("tau", LogUniform(0.01, 1000.0))
ALPHA = ordered("alpha", Uniform(-5.0, 10.0), unit="1", ordered_from="largest")
RELAXATION = ordered("relaxation", LogNormal(10.0, 1.5), size=2)
MU = tuple(
    parameter(f"mu_{k}", LogNormal(5e4, 1.0), "Pa", half_product_with=f"alpha_{k}")
    for k in (1, 2, 3)
)
FREE = (
    parameter("thickness", TruncatedNormal(1e-4, 1e-5, 0.0), "m"),
    parameter("zeta_alpha", LogNormal(1e3, 2.0), "Pa s"),
    parameter("offset", Normal(0.5, 0.1)),
)
EVERYTHING = (*MU, *FREE, *TAU, *ALPHA, *RELAXATION)


def assert_density_is_jacobian(prior, z, tolerance=1e-5):
    """log p(theta) + log |d theta / d z| = log N(z)."""
    step = 1e-5
    for point in z:
        shifted = np.tile(point, (2 * point.size, 1))
        rows = np.arange(point.size)
        shifted[rows, rows] += step
        shifted[rows + point.size, rows] -= step
        theta = prior.to_parameters(shifted)
        jacobian = (theta[: point.size] - theta[point.size :]) / (2.0 * step)
        size = np.abs(jacobian).max(axis=0)
        log_volume = np.linalg.slogdet(jacobian / size)[1] + np.log(size).sum()
        log_density = prior.log_density(prior.to_parameters(point[None]))[0]
        expected = stats.norm.logpdf(point).sum()
        assert log_density + log_volume == pytest.approx(expected, abs=tolerance)
