"""Populations carried from one density to another: evidence, moments, and what they share."""

import numpy as np
import pytest

from deabayes.comparison.left_out import ON_THE_WAY
from deabayes.sampling.problem import Coordinates, EveryDrawFailed, log_standard_normal
from deabayes.sampling.tempering import Schedule, _Cloud, systematic, temper

WIDTH, CENTRE = 0.2, 0.7


def narrow(z):
    return -0.5 * np.sum(((z - CENTRE) / WIDTH) ** 2, axis=1)


def log_evidence(dimension):
    """log of the integral of N(0, I) exp(narrow)."""
    total = 1.0 + WIDTH**2
    return dimension * (np.log(WIDTH) - 0.5 * np.log(total) - 0.5 * CENTRE**2 / total)


def from_prior(log_likelihood, dimension, populations, particles, seed=1, **more):
    start = np.random.default_rng(seed).standard_normal((populations, particles, dimension))
    more = {"schedule": Schedule()} | more
    return temper(
        start, log_standard_normal, log_likelihood, np.random.SeedSequence(seed + 100), **more
    )


def test_evidence_and_moments_of_a_gaussian():
    found = from_prior(narrow, 4, 8, 500)
    error = found.log_evidence.std(ddof=1)
    assert error < 0.2
    assert found.log_evidence.mean() == pytest.approx(log_evidence(4), abs=4 * error / np.sqrt(8))
    variance = 1.0 / (1.0 + 1.0 / WIDTH**2)
    z = found.particles.reshape(-1, 4)
    assert z.mean() == pytest.approx(variance * CENTRE / WIDTH**2, abs=0.01)
    assert z.std(axis=0) == pytest.approx(np.full(4, np.sqrt(variance)), rel=0.06)
    assert (found.broad.std(axis=(0, 1)) > z.std(axis=0)).all()
    np.testing.assert_allclose(found.log_density.ravel(), narrow(z) + log_standard_normal(z))
    assert found.betas[0] == 0.0 and found.betas[-1] == 1.0
    assert (np.diff(found.betas) > 0.0).all()


def test_crossed_populations_are_unbiased():
    """On the scale of the ratio itself, of which the estimate is unbiased."""
    schedule = Schedule(rounds=(2, 10), final_rounds=(0, 0), crossed=True)
    found = from_prior(narrow, 5, 32, 150, schedule=schedule)
    ratios = np.exp(found.log_evidence - log_evidence(5))
    error = ratios.std(ddof=1) / np.sqrt(ratios.size)
    assert error < 0.1
    assert ratios.mean() == pytest.approx(1.0, abs=3 * error)


def test_crossed_populations_are_moved_by_what_is_fitted_to_the_other_half():
    start = np.random.default_rng(9).standard_normal((4, 200, 2))
    start += np.array([-6.0, -2.0, 2.0, 6.0])[:, None, None]
    seed = np.random.SeedSequence(10)
    cloud = _Cloud(start, log_standard_normal, narrow, None, seed, Coordinates(), ())
    rng = np.random.default_rng(11)
    fitted = [each.sample(rng, 2000).mean() for each in cloud.proposals(crossed=True)]
    assert fitted == pytest.approx([2.0, -2.0, 2.0, -2.0], abs=0.3)
    (common,) = cloud.proposals(crossed=False)
    assert common.sample(rng, 2000).mean() == pytest.approx(0.0, abs=0.5)


def test_the_evidence_of_a_record_is_found_by_leaving_it_out():
    """Gaussian records: log p(y2 | y1) by leaving y2 out of the posterior of both."""

    def log_normal(z, data, sd):
        return (-0.5 * ((z - data) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))).sum(axis=1)

    def joint(z):
        return log_normal(z, 0.5, 0.3) + log_normal(z, 0.9, 0.4) + log_standard_normal(z)

    precision = 1.0 + 1.0 / 0.09 + 1.0 / 0.16
    rng = np.random.default_rng(2)
    start = (0.5 / 0.09 + 0.9 / 0.16) / precision
    start = start + rng.standard_normal((2, 1024, 3)) / np.sqrt(precision)
    found = temper(
        start, joint, lambda z: -log_normal(z, 0.9, 0.4), np.random.SeedSequence(3), ON_THE_WAY
    )
    variance = 1.0 / (1.0 + 1.0 / 0.09)
    before = variance * 0.5 / 0.09
    sd = np.sqrt(variance + 0.16)
    predictive = 3 * float(log_normal(np.array([[0.9]]), before, sd)[0])
    assert -found.log_evidence == pytest.approx(np.full(2, predictive), abs=0.15)
    assert found.particles.mean() == pytest.approx(before, abs=0.05)


@pytest.mark.parametrize("lost", [1.0, 0.5])
def test_a_population_that_fails_everywhere_is_an_error(lost):
    """Half of the prior fails, or all of one population."""

    def failing(z):
        return np.where(z[:, 0] < 0.0, np.nan, narrow(z))

    start = np.random.default_rng(4).standard_normal((2, 400, 2))
    start[1, : int(lost * 400), 0] = -np.abs(start[1, : int(lost * 400), 0])
    seed = np.random.SeedSequence(5)
    if lost == 1.0:
        with pytest.raises(EveryDrawFailed, match="every draw of the prior failed"):
            temper(start, log_standard_normal, failing, seed)
        return
    found = temper(start, log_standard_normal, failing, seed)
    assert found.particles[..., 0].min() > 0.0
    assert np.isfinite(found.log_density).all()


def test_populations_share_no_particles():
    """Populations that start elsewhere keep to themselves: no particle is another's copy."""
    start = np.random.default_rng(6).standard_normal((3, 200, 2)) * 0.05
    start += np.array([-5.0, 0.0, 5.0])[:, None, None]

    def far_apart(z):
        nearest = 5.0 * np.round(np.clip(z / 5.0, -1.0, 1.0))
        return -0.5 * (((z - nearest) / 0.05) ** 2).sum(axis=1)

    schedule = Schedule(rounds=(0, 0), final_rounds=(0, 0))
    found = temper(start, far_apart, lambda z: -z[:, 0] ** 2 % 1.0, np.random.SeedSequence(7),
                   schedule)  # fmt: skip
    np.testing.assert_allclose(found.particles.mean(axis=(1, 2)), [-5.0, 0.0, 5.0], atol=0.1)


def test_the_final_density_is_evaluated_alone_at_the_end():
    """Not base and increment, which together may cost more."""
    asked = {"base": 0, "increment": 0, "final": 0}

    def counted(name, density):
        def count(z):
            asked[name] += 1
            return density(z)

        return count

    start = np.random.default_rng(3).standard_normal((2, 200, 2))

    def increment(z):
        return -0.5 * ((z - 1.0) ** 2).sum(axis=1) / 0.5**2

    def final(z):
        return log_standard_normal(z) + increment(z)

    found = temper(
        start,
        counted("base", log_standard_normal),
        counted("increment", increment),
        np.random.SeedSequence(8),
        log_final=counted("final", final),
    )
    assert asked["base"] == asked["increment"] and asked["final"] > 0
    np.testing.assert_allclose(found.log_density.ravel(), final(found.particles.reshape(-1, 2)))
    np.testing.assert_allclose(found.particles.mean(axis=(0, 1)), 0.8, atol=0.1)


def test_systematic_resampling_repeats_particles_by_their_weights():
    weights = np.array([0.1, 0.0, 0.4, 0.25, 0.25]) * 3.0
    counts = np.zeros(5)
    rng = np.random.default_rng(8)
    for _ in range(2000):
        picked = systematic(weights, rng)
        counts += np.bincount(picked, minlength=5)
        assert np.bincount(picked, minlength=5)[2] == 2
    np.testing.assert_allclose(counts / counts.sum(), weights / weights.sum(), atol=0.01)
