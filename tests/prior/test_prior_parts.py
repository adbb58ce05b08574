"""Parameters that are parts of a total, which has the prior."""

import numpy as np
import pytest
from scipy import stats
from tests.shared.priors import ALPHA, assert_density_is_jacobian, parameter

from deabayes.faults import Faults
from deabayes.prior.distributions import LogNormal
from deabayes.prior.joint import Prior

STRETCHES = (3.5, 0.06)
STRESS_PARTS = tuple(
    parameter(f"mu_{k}", LogNormal(1e6, 1.0), "Pa", half_product_with=f"alpha_{k}",
              reference_stretches=STRETCHES, part_of="stress")
    for k in (1, 2, 3)
)  # fmt: skip


def stress_parts(theta):
    """Contributions (W, 3) of the terms of theta (W, 6) at the reference stretches."""
    first, third = (stretch ** theta[:, 3:] for stretch in STRETCHES)
    return theta[:, :3] * (first - third)


def test_parts_make_up_a_total_that_has_the_prior():
    prior = Prior((*STRESS_PARTS, *ALPHA))
    z = np.random.default_rng(5).standard_normal((4000, 6))
    theta = prior.to_parameters(z)
    np.testing.assert_allclose(prior.to_normal(theta), z, atol=1e-8)
    assert_density_is_jacobian(prior, z[:5], 1e-4)
    parts = stress_parts(theta)
    assert np.all(parts > 0.0)
    total = parts.sum(axis=1)
    assert stats.kstest(np.log(total / 1e6), "norm").pvalue > 0.01
    for k in range(3):
        fraction = parts[:, k] / total
        assert stats.kstest(fraction, stats.beta(1, 2).cdf).pvalue > 0.01
        assert abs(np.corrcoef(fraction, np.log(total))[0, 1]) < 0.05
    theta[0, 1] *= -1.0
    assert prior.log_density(theta)[0] == -np.inf
    assert np.isnan(prior.to_normal(theta)[0]).any()


def test_one_part_is_the_total():
    alone = parameter("mu_1", LogNormal(1e6, 1.0), "Pa", part_of="stress")
    prior = Prior((alone,))
    same = Prior((parameter("mu_1", LogNormal(1e6, 1.0), "Pa"),))
    theta = np.array([[2e5], [3e6]])
    np.testing.assert_allclose(prior.log_density(theta), same.log_density(theta))


def test_the_prior_of_a_total_is_set_by_the_total_s_name():
    settings = {"distribution": "lognormal", "median": "2 MPa", "sigma": 0.3}
    prior = Prior.from_parameters((*STRESS_PARTS, *ALPHA), {"stress": settings})
    assert {p.prior for p in prior.parameters[:3]} == {LogNormal(2e6, 0.3)}
    assert "a part of stress" in prior.describe("mu_1")
    with pytest.raises(Faults, match=r"set priors\.stress"):
        Prior.from_parameters((*STRESS_PARTS, *ALPHA), {"mu_1": settings})
