"""Proposals: straightened coordinates are exact, normalised, and follow curved ridges."""

import numpy as np
import pytest

from deabayes.sampling.proposal import Part, Proposal, fit
from deabayes.sampling.warp import fit_warp


def ridge(n=4000, seed=0):
    """x ~ N(0, 1), y | x ~ N(x^2 / 4, 0.02^2), w | x, y ~ N(x y / 2, 0.05^2)."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(n)
    y = x**2 / 4 + 0.02 * rng.standard_normal(n)
    return np.column_stack([x, y, 0.5 * x * y + 0.05 * rng.standard_normal(n)])


def log_ridge(z):
    x, y, w = z.T
    widths = -np.log(0.02) - np.log(0.05) - 1.5 * np.log(2 * np.pi)
    return -0.5 * (x**2 + ((y - x**2 / 4) / 0.02) ** 2 + ((w - x * y / 2) / 0.05) ** 2) + widths


def funnel(n=8000, seed=5):
    """x ~ N(0, 1), y | x ~ N(0, exp(x)^2): wide at one end, narrow at the other."""
    x, y = np.random.default_rng(seed).standard_normal((2, n))
    return np.column_stack([x, y * np.exp(x)])


def test_a_width_that_varies_along_a_ridge_is_evened_out():
    straight = fit_warp(funnel()).forward(funnel(seed=6))
    wide, narrow = straight[straight[:, 0] > 1, 1], straight[straight[:, 0] < -1, 1]
    assert wide.std() == pytest.approx(narrow.std(), rel=0.25)


def test_warp_and_its_inverse():
    warp = fit_warp(ridge())
    z = 3 * np.random.default_rng(1).standard_normal((500, 3))
    assert warp.inverse(warp.forward(z)) == pytest.approx(z, abs=1e-9)


def test_log_jacobian_is_that_of_finite_differences():
    warp = fit_warp(ridge())
    for z in np.random.default_rng(1).standard_normal((5, 3)):
        shifts = 1e-5 * np.eye(3)
        jacobian = (warp.forward(z + shifts) - warp.forward(z - shifts)) / 2e-5
        assert np.linalg.slogdet(jacobian)[1] == pytest.approx(
            warp.straighten(z[None])[1][0], abs=1e-5
        )


def test_density_and_samples_are_the_same_law():
    """E_g[h / g] = 1 for the ridge's density h, and E_h[g / h] <= 1."""
    proposal = fit(ridge(), 4, np.random.default_rng(1))
    assert len(proposal.parts) == 2
    z = proposal.sample(np.random.default_rng(2), 100_000)
    ratio = np.exp(log_ridge(z) - proposal.log_density(z))
    assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(len(z)))


def accepted(proposal):
    """Share of independence proposals that is accepted on the ridge."""
    draws = ridge(seed=3)
    proposed = proposal.sample(np.random.default_rng(4), len(draws))
    now = log_ridge(draws) - proposal.log_density(draws)
    then = log_ridge(proposed) - proposal.log_density(proposed)
    return np.exp(np.minimum(0, then - now)).mean()


def test_straightening_raises_the_acceptance_of_a_curved_ridge():
    proposal = fit(ridge(), 4, np.random.default_rng(1))
    plain = Proposal((Part(1.0, proposal.parts[1].mixture),))
    assert accepted(proposal) > accepted(plain) + 0.1


@pytest.mark.parametrize(
    "samples",
    [ridge(20), np.repeat(ridge(50), 40, axis=0), ridge()[:, :1]],
    ids=["few", "duplicates", "one dimension"],
)
def test_no_straightening_where_the_samples_do_not_allow_it(samples):
    proposal = fit(samples, 4, np.random.default_rng(1))
    assert len(proposal.parts) == 1
    assert np.isfinite(proposal.log_density(samples)).all()


def test_a_covering_part_reaches_what_the_rest_leaves_out():
    """Draws of a Gaussian with a rare far cluster that one component smears over."""
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((5000, 2))
    samples[:50] = 0.05 * rng.standard_normal((50, 2)) + 8
    near = np.exp(-0.5 * (samples**2).sum(1)) / (2 * np.pi)
    far = np.exp(-0.5 * (((samples - 8) / 0.05) ** 2).sum(1)) / (2 * np.pi * 0.05**2)
    log_density = np.log(0.99 * near + 0.01 * far + 1e-300)
    largest = [
        (log_density - fit(samples, 1, rng, given).log_density(samples)).max()
        for given in (None, log_density)
    ]
    assert largest[1] < largest[0] - 1


def test_same_seed_same_proposal():
    first, second = (fit(ridge(), 4, np.random.default_rng(7), log_ridge(ridge())) for _ in "ab")
    z = first.sample(np.random.RandomState(1), 50)
    assert len(first.parts) == 4
    assert first.log_density(z).tobytes() == second.log_density(z).tobytes()
