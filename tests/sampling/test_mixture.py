"""Proposal mixtures: normalised, sampled from the law they state, robust, reproducible."""

import numpy as np
import pytest

from deabayes.sampling.mixture import fit


def two_clusters(n=2000, dimension=3, seed=0):
    rng = np.random.default_rng(seed)
    samples = rng.standard_normal((n, dimension)) * 0.1
    samples[: n // 4] += 4.0
    return samples


def test_density_integrates_to_one_in_one_dimension():
    mixture = fit(two_clusters(dimension=1), 2, np.random.default_rng(1))
    grid = np.linspace(-200, 200, 400001)
    mass = np.exp(mixture.log_density(grid[:, None])).sum() * (grid[1] - grid[0])
    assert mass == pytest.approx(1.0, abs=1e-4)


def test_density_and_samples_are_the_same_law():
    """E_g[h / g] = 1 for a density h lighter-tailed than g."""
    mixture = fit(two_clusters(dimension=4), 3, np.random.default_rng(1))
    z = mixture.sample(np.random.default_rng(2), 200_000)
    shift, scale = mixture.means[0], 0.08
    log_h = -0.5 * (((z - shift) / scale) ** 2).sum(1) - 4 * np.log(scale * np.sqrt(2 * np.pi))
    ratio = np.exp(log_h - mixture.log_density(z))
    assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(len(z)))


@pytest.mark.parametrize("source", [np.random.default_rng(3), np.random.RandomState(3)])
def test_finds_both_clusters_and_is_wider_than_they_are(source):
    """Weights to three binomial standard deviations of the samples that are fitted."""
    mixture = fit(two_clusters(), 2, np.random.default_rng(1))
    within = 3 * np.sqrt(0.25 * 0.75 / 2000)
    assert sorted(mixture.weights) == pytest.approx([0.25, 0.75], abs=within)
    z = mixture.sample(source, 50_000)
    upper = z[:, 0] > 2
    assert upper.mean() == pytest.approx(min(mixture.weights), abs=0.01)
    assert 1.1 < z[upper].std(axis=0).mean() / 0.1 < 1.4


@pytest.mark.parametrize(
    "samples",
    [
        np.repeat(np.random.default_rng(0).standard_normal((3, 5)), 100, axis=0),
        np.column_stack([np.random.default_rng(0).standard_normal(500), np.full(500, 2.0)]),
        np.outer(np.random.default_rng(0).standard_normal(500), [1.0, 2.0, 3.0]),
        np.vstack([np.full((1, 2), np.nan), np.random.default_rng(0).standard_normal((50, 2))]),
    ],
    ids=["duplicates", "constant column", "one line", "a NaN row"],
)
def test_degenerate_samples_still_give_a_proper_proposal(samples):
    mixture = fit(samples, 8, np.random.default_rng(1))
    z = mixture.sample(np.random.default_rng(2), 100)
    assert np.isfinite(z).all()
    assert np.isfinite(mixture.log_density(z)).all()
    assert mixture.weights.sum() == pytest.approx(1.0)


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 2 finite samples"):
        fit(np.full((5, 2), np.nan), 4, np.random.default_rng(0))


def test_same_seed_same_mixture():
    first, second = (fit(two_clusters(), 4, np.random.default_rng(7)) for _ in range(2))
    z = first.sample(np.random.default_rng(1), 50)
    assert first.log_density(z).tobytes() == second.log_density(z).tobytes()
