"""Left-out blocks and records against closed forms of a linear Gaussian model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from deabayes.comparison.blocks import leave_one_block_out
from deabayes.comparison.evidence import leave_one_experiment_out
from deabayes.comparison.left_out import ON_THE_WAY, leave_blocks_out, left_out_log_densities
from deabayes.inference.blocks import block_edges, block_terms
from deabayes.sampling.problem import Problem, log_standard_normal
from deabayes.sampling.tempering import temper

POINTS, BLOCKS, SIGMA = 24, 8, 0.5
ALONE = Problem(lambda z: z, 2)


def line(outlier=0.0):
    """z ~ N(0, I) of a line's level and slope, and data about it, one block of them moved."""
    rng = np.random.default_rng(3)
    design = np.column_stack([np.ones(POINTS), np.linspace(-1.0, 1.0, POINTS)])
    data = design @ [0.4, -0.7] + SIGMA * rng.normal(size=POINTS)
    data[-3:] += outlier
    return design, data


def of_block(block):
    return slice(3 * block, 3 * block + 3)


def posterior(design, data):
    precision = np.eye(design.shape[1]) + design.T @ design / SIGMA**2
    covariance = np.linalg.inv(precision)
    return covariance @ design.T @ data / SIGMA**2, covariance


def log_densities(design, data, z):
    """(S, N)"""
    return norm(z @ design.T, SIGMA).logpdf(data)


def exact(design, data, left):
    """log p(points left out | the others)."""
    kept = np.ones(POINTS, bool)
    kept[left] = False
    mean, covariance = posterior(design[kept], data[kept])
    there = design[~kept]
    spread = there @ covariance @ there.T + SIGMA**2 * np.eye(len(there))
    return float(multivariate_normal(there @ mean, spread).logpdf(data[~kept]))


def blocks_of(pointwise):
    return pointwise.reshape(len(pointwise), BLOCKS, 3).sum(axis=2)


def test_importance_weights_leave_a_block_out():
    design, data = line()
    rng = np.random.default_rng(1)
    z = rng.multivariate_normal(*posterior(design, data), size=20000)
    terms = blocks_of(log_densities(design, data, z))
    found = leave_one_block_out(terms)
    wanted = [exact(design, data, of_block(block)) for block in range(BLOCKS)]
    assert np.all(found.k_hat < 0.7)
    np.testing.assert_allclose(found.terms, wanted, atol=0.05)
    assert found.elpd < np.log(np.mean(np.exp(terms), axis=0)).sum(), "better than in the fit"


def test_an_unexpected_block_has_unreliable_weights_and_is_sampled():
    design, data = line(outlier=4.0)
    rng = np.random.default_rng(2)
    z = rng.multivariate_normal(*posterior(design, data), size=1000)
    found = leave_one_block_out(blocks_of(log_densities(design, data, z)))
    last, wanted = BLOCKS - 1, exact(design, data, of_block(BLOCKS - 1))
    assert found.k_hat[last] > 0.7
    assert found.terms[last] > wanted + 0.5, "weights would do"

    found = every_block(design, data, z[:512])
    exact_terms = [exact(design, data, of_block(block)) for block in range(BLOCKS)]
    np.testing.assert_allclose(found, exact_terms, atol=0.3)


def every_block(design, data, z):
    """All blocks left out, each one alone, in lockstep."""

    def densities(z, piece):
        terms = blocks_of(log_densities(design, data, z))
        left = terms[np.arange(len(z)), piece]
        return terms.sum(axis=1) - left - 0.5 * np.sum(z**2, axis=1), left

    return left_out_log_densities(densities, BLOCKS, z, np.random.SeedSequence(3))


def one(log_rest, log_left):
    """Densities where a single piece is left out."""
    return lambda z, piece: (log_rest(z), log_left(z))


def test_draws_without_a_response_to_the_left_out_data_count():
    """z ~ N(0, 1); what is left out is impossible below 0.5 and indifferent above."""
    rng = np.random.default_rng(4)
    z = rng.normal(size=(4000, 1))
    z = z[z[:, 0] > 0.5][:512]
    densities = one(lambda z: -0.5 * z[:, 0] ** 2, lambda z: np.where(z[:, 0] > 0.5, 0.0, np.nan))
    found = left_out_log_densities(densities, 1, z, np.random.SeedSequence(4))
    assert found == pytest.approx(norm.logsf(0.5), abs=0.2)


def mirrored(z, random):
    """Half of the draws hop to where the sign is the other."""
    return z * random.choice([-1.0, 1.0], size=(len(z), 1)), np.zeros(len(z))


@pytest.mark.parametrize(
    ("hops", "off"), [((mirrored,), 0.0), ((), np.log(2.0))], ids=["hop", "none"]
)
def test_hops_lead_to_modes_that_only_the_left_out_data_exclude(hops, off):
    """The rest tells |z| = 3 within 0.2, what is left out z within 0.2 of 3: half the mass."""
    densities = one(
        lambda z: norm(3.0, 0.2).logpdf(np.abs(z[:, 0])),
        lambda z: norm(3.0, 0.2).logpdf(z[:, 0]),
    )
    z = 3.0 + 0.2 / np.sqrt(2.0) * np.random.default_rng(6).standard_normal((1024, 1))
    found = left_out_log_densities(densities, 1, z, np.random.SeedSequence(7), hops=hops)
    exact = norm(0.0, 0.2 * np.sqrt(2.0)).logpdf(0.0) - np.log(2.0)
    assert found - exact == pytest.approx(off, abs=0.15)


def test_blocks_are_left_out_with_the_hops_of_the_posterior():
    target, z = three_records()
    seen = []

    def stay(z, random):
        seen.append(len(z))
        return z, np.zeros(len(z))

    problem = Problem(lambda z: z, 2, hops=(stay,))
    leave_blocks_out(target, problem, [("b", slice(6, 12))], z[:256], np.random.SeedSequence(1))
    assert set(seen) == {256}


def test_half_of_the_data_on_many_parameters_are_left_out_without_bias():
    """The way that only widens came out too good by 0.8."""
    rng = np.random.default_rng(1)
    design = rng.normal(size=(48, 12))
    data = design @ rng.normal(size=12) + SIGMA * rng.normal(size=48)
    kept = np.arange(48) >= 24
    mean, covariance = posterior(design[kept], data[kept])
    spread = design[~kept] @ covariance @ design[~kept].T + SIGMA**2 * np.eye(24)
    wanted = multivariate_normal(design[~kept] @ mean, spread).logpdf(data[~kept])

    def log_of(part, z):
        return norm(z @ design[part].T, SIGMA).logpdf(data[part]).sum(axis=1)

    z = rng.multivariate_normal(*posterior(design, data), size=512)
    densities = one(
        lambda z: log_of(kept, z) - 0.5 * np.sum(z**2, axis=1), lambda z: log_of(~kept, z)
    )
    found = left_out_log_densities(densities, 1, z, np.random.SeedSequence(1))
    assert found == pytest.approx(wanted, abs=0.4)


def test_data_that_alone_inform_many_parameters_are_left_out_without_bias():
    """Proposals fitted to the particles that they move drew them together: too good by 0.4."""
    errors = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        data = rng.standard_normal(6) * np.sqrt(1.0 + 1e-4)
        found = temper(
            rng.standard_normal((2, 128, 8)),
            lambda z: -0.5 * np.sum(z**2, axis=1),
            lambda z, data=data: norm(data, 1e-2).logpdf(z[:, :6]).sum(axis=1),
            np.random.SeedSequence(seed),
            ON_THE_WAY,
        )
        exact = norm(0.0, np.sqrt(1.0 + 1e-4)).logpdf(data).sum()
        errors.append(np.mean(found.log_evidence) - exact)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.4)


@dataclass(frozen=True)
class Line:
    """The line's posterior with its blocks as records, one of them a gain with its phase."""

    records: tuple[SimpleNamespace, ...]
    prior = SimpleNamespace(to_parameters=lambda z: z)

    def pointwise_log_likelihood(self, theta):
        whole = log_densities(*line(), theta)
        return {r.experiment.name: whole[:, r.part] for r in self.records}

    def log_density_beside_records(self, theta, z):
        return np.zeros(len(z))

    def log_likelihood(self, z):
        return sum(points.sum(axis=1) for points in self.pointwise_log_likelihood(z).values())

    def __call__(self, z):
        return self.log_likelihood(z) + log_standard_normal(z)


def three_records():
    parts = {"a": slice(0, 9), "a_phase": slice(9, 12), "b": slice(12, 24)}
    records = tuple(
        SimpleNamespace(part=part, experiment=SimpleNamespace(name=name, row=name[0]))
        for name, part in parts.items()
    )
    z = np.random.default_rng(5).multivariate_normal(*posterior(*line()), size=600)
    return Line(records), z


def test_every_record_is_left_out_as_a_whole(monkeypatch):
    target, z = three_records()
    monkeypatch.setattr(
        "deabayes.comparison.evidence.problem_of", lambda t: Problem(t.log_likelihood, 2)
    )
    mean, cov = np.zeros(24), SIGMA**2 * np.eye(24) + line()[0] @ line()[0].T
    whole = multivariate_normal(mean, cov).logpdf(line()[1])
    found = leave_one_experiment_out(target, whole, z, np.random.SeedSequence(1))
    assert found == pytest.approx(
        {"a": exact(*line(), slice(0, 12)), "b": exact(*line(), slice(12, 24))}, abs=0.1
    )
    alone = replace(target, records=target.records[:2])
    assert leave_one_experiment_out(alone, whole, z, np.random.SeedSequence(1)) == {}


def test_populations_that_disagree_give_no_score(monkeypatch):
    target, z = three_records()
    monkeypatch.setattr(
        "deabayes.comparison.evidence.problem_of", lambda t: Problem(t.log_likelihood, 2)
    )
    monkeypatch.setattr("deabayes.comparison.evidence.LARGEST_ERROR", 1e-6)
    found = leave_one_experiment_out(target, 0.0, z, np.random.SeedSequence(1))
    assert list(found) == ["a", "b"] and np.isnan(list(found.values())).all()


def test_the_error_of_a_rough_solution_is_corrected(monkeypatch):
    """Rough by a factor of the likelihood that grows along one parameter.

    One run scatters by 0.08, so that the mean of four has a standard error of 0.04.
    """
    target, z = three_records()

    def problem(target):
        def rough(z):
            return target.log_likelihood(z) + 3.0 + 2.0 * z[:, 0]

        return Problem(target.log_likelihood, 2, rough=Problem(rough, 2))

    monkeypatch.setattr("deabayes.comparison.evidence.problem_of", problem)
    streams = np.random.SeedSequence(1).spawn(4)
    found = np.mean([leave_one_experiment_out(target, 0.0, z, stream)["a"] for stream in streams])
    rest = multivariate_normal(
        np.zeros(12), SIGMA**2 * np.eye(12) + line()[0][12:] @ line()[0][12:].T
    ).logpdf(line()[1][12:])
    assert found == pytest.approx(-rest, abs=0.1)


def test_a_block_of_a_record_is_left_out():
    target, z = three_records()
    blocks = [("b", slice(6, 12)), ("a", slice(0, 3))]
    found = leave_blocks_out(target, ALONE, blocks, z, np.random.SeedSequence(1))
    wanted = [exact(*line(), slice(18, 24)), exact(*line(), slice(0, 3))]
    np.testing.assert_allclose(found, wanted, atol=0.1)


def test_a_block_that_alone_informs_some_parameters_is_left_out_without_bias():
    """As the first points of a creep do of a fast unit; the way out alone is 0.6 too good."""
    design, data = line()
    fast = np.zeros((POINTS, 3))
    fast[:3] = 3.0 * np.eye(3)
    design, data = np.column_stack([design, fast]), data + fast @ [1.0, -0.6, 0.8]
    mean, covariance = posterior(design, data)

    class Whole:
        prior = SimpleNamespace(to_parameters=lambda z: z)

        def pointwise_log_likelihood(self, theta):
            return {"creep": log_densities(design, data, theta)}

        def log_density_beside_records(self, theta, z):
            return np.zeros(len(z))

    found = [
        leave_blocks_out(
            Whole(), Problem(None, 5), [("creep", slice(0, 3))],
            np.random.default_rng(seed).multivariate_normal(mean, covariance, size=256),
            np.random.SeedSequence(seed),
        )
        for seed in (1, 2)
    ]  # fmt: skip
    assert np.mean(found) == pytest.approx(exact(design, data, slice(0, 3)), abs=0.3)


def test_blocks_are_long_enough_and_cover_every_point():
    coordinate = np.concatenate([np.linspace(0, 1, 50), np.linspace(1.1, 100, 40)])
    edges = block_edges(coordinate, 10.0)
    starts = coordinate[edges]
    assert edges[0] == 0 and np.all(np.diff(starts) >= 10.0)
    pointwise = np.random.default_rng(1).normal(size=(3, coordinate.size))
    terms = block_terms(pointwise, edges)
    np.testing.assert_allclose(terms.sum(1), pointwise.sum(1))


def test_the_last_block_takes_a_rest_shorter_than_half_a_block():
    assert block_edges(np.arange(25.0), 10.0).tolist() == [0, 10]
    assert block_edges(np.arange(26.0), 10.0).tolist() == [0, 10, 20]
    assert block_edges(np.arange(12.0), 10.0).tolist() == [0, 10]
