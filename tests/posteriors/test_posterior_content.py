"""What a posterior file keeps of the runs; how far a posterior is narrower than its prior."""

from __future__ import annotations

import warnings
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtri
from tests.validation.tubular_worlds import tubular

from deabayes.posteriors.content import convergence_summary, times_off_records
from deabayes.posteriors.file import contraction, contractions
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter
from deabayes.sampling.diagnostics import Failed
from deabayes.sampling.engine import Sampled

SHORT = Failed("length", "run 1", "too short", -9.0)


def sampled(steps=6, convergence=None):
    """Two ensembles whose draw of step s and walker w is (10 s + w, -10 s - w)."""
    place = np.tile(10.0 * np.arange(steps)[:, None] + np.arange(2.0), (2, 1, 1))
    return Sampled(
        np.stack([place, -place], axis=-1), -0.5 * place, convergence,
        steps=3 * steps, burn_in=2 * steps, thin=1, rounds=3, acceptance=0.3,
        evaluations=1500, failures=11,
    )  # fmt: skip


def test_thinned_draws_keep_their_density_and_span_the_runs():
    z, log_posterior = sampled().thinned(4)
    assert z.shape == (2, 4, 2)
    np.testing.assert_array_equal(z[0, :, 0] // 10.0, [0.0, 1.0, 3.0, 5.0])
    np.testing.assert_array_equal(z[..., 1], -z[..., 0])
    np.testing.assert_array_equal(log_posterior, -0.5 * z[..., 0])
    every = sampled().thinned(2000)[0]
    assert every.shape == (2, 12, 2) and np.unique(every[0, :, 0]).size == 12


@pytest.mark.parametrize("steps", [999, 1000, 1001, 1998, 4000])
def test_thinned_draws_are_of_all_walkers(steps):
    """Of 64; even distances of 1000 among 999 or 1000 steps were of one or two."""
    walkers = np.tile(np.arange(64.0), (1, steps, 1))
    found = replace(sampled(), chain=walkers[..., None], log_posterior=walkers)
    counts = np.bincount(found.thinned(1000)[1][0].astype(int), minlength=64)
    assert counts.min() >= 3 and counts.max() <= 40


def test_the_worst_number_of_all_runs_and_quantities_is_kept():
    table = pd.DataFrame(
        {"r_hat": [1.001, 1.02], "ess_bulk": [900.0, 500.0], "ess_tail": [300.0, 800.0]}
    )
    shares = pd.DataFrame({"run 1": [0.9, 0.1], "run 2": [0.8, 0.2]})
    convergence = SimpleNamespace(
        converged=False, failed=[SHORT], table=table, mode_shares=shares,
        autocorrelation_times=np.array([60.0, 40.0]), length=48.0,
    )  # fmt: skip
    assert convergence_summary(sampled(80, convergence=convergence)) == {
        "converged": False, "reasons": ["run 1: too short; sample longer"],
        "failed_gates": [asdict(SHORT)], "r_hat_max": 1.02, "ess_bulk_min": 500.0,
        "ess_tail_min": 300.0, "autocorrelation_times": [60.0, 40.0],
        "length": 48.0, "tau": 80.0 / 48.0, "steps": 240,
        "walkers": 2, "ensembles": 2, "acceptance": 0.3, "refitted": True,
        "failures": {"evaluations": 1500, "failed": 11},
        "mode_shares": [[0.9, 0.8], [0.1, 0.2]],
    }  # fmt: skip


def record(length, name="time", first=0.002):
    """A record under a constant excitation from time 0; the first point comes late."""
    times = np.linspace(first, length, 1000)
    driven = SimpleNamespace(coordinate=np.array([0.0, length]), values=np.ones(2))
    found = SimpleNamespace(
        coordinate_name=name, elapsed=length, coordinate=times, excitation=driven
    )
    return SimpleNamespace(experiment=found)


@pytest.mark.parametrize("inherited", [True, False])
@pytest.mark.parametrize(
    ("share", "value", "said"),
    [
        (0.06, 40.0, "the longest calibrated record lasts 0.3 s"),
        (0.04, 40.0, None),
        (0.06, 1e-4, "no calibrated record shows times below 500 µs"),
        (0.04, 1e-4, None),
    ],
)
def test_relaxation_times_that_no_record_shows_are_warned_of(share, value, said, inherited):
    names = ("tau_1", "tau_2", "k_2")
    parameters = [
        Parameter(name, "", "s", "", LogUniform(0.01, 500.0), "", ordered=group)
        for name, group in zip(names, ("tau", "tau", None), strict=True)
    ]
    theta = np.tile([0.2, 0.29, 9.0], (100, 1))
    theta[: int(100 * share), 1] = value
    blocks = (SimpleNamespace(names=("tau_2",)),) if inherited else ()
    target = SimpleNamespace(
        prior=SimpleNamespace(parameters=parameters, inherited=blocks),
        records=[record(0.1), record(0.3), record(1e3, "frequency")],
        system=SimpleNamespace(time_scale=1.0),
    )
    found = times_off_records(target, theta)
    assert len(found) == int(said is not None and not inherited)
    assert all(line.startswith("tau_2: 5 % of its draws") and said in line for line in found)
    target.records = target.records[2:]
    assert times_off_records(target, theta) == []


NORMAL = np.random.default_rng(1).standard_normal(20000)


@pytest.mark.parametrize(
    ("posterior", "prior"),
    [
        (np.exp(5.0 + 0.5 * NORMAL), np.exp(NORMAL)),  # on the logarithm, wherever it lies
        (5.0 + 0.5 * NORMAL, NORMAL),  # as it is, where it changes its sign
        (np.exp(0.5 * NORMAL), np.append(np.exp(NORMAL), np.nan)),  # a failed draw of the prior
        (np.append(0.5 * NORMAL, 1e9), NORMAL),  # one draw far out
    ],
)
def test_half_the_spread_is_a_contraction_of_three_quarters(posterior, prior):
    assert contraction(posterior, prior) == pytest.approx(0.75, abs=0.005)


def test_a_wider_posterior_has_a_negative_contraction():
    assert contraction(2.0 * NORMAL, NORMAL) == pytest.approx(-3.0)


def told(prior: Prior, theta: np.ndarray) -> list[float]:
    """Contraction of each of the prior's parameters for draws theta."""
    before = prior.sample(np.random.default_rng(2), 20000)
    after, given = (dict(zip(prior.names, each.T, strict=True)) for each in (theta, before))
    return list(contractions(prior, prior.to_normal(theta), after, given).values())


def test_contraction_of_an_ordered_time_does_not_depend_on_the_other():
    """Either is log-uniform from 1 ms to 1000 s; one is found at 1 s, the other's bound is that."""
    times = [
        Parameter(f"tau_{i}", "", "s", "", LogUniform(1e-3, 1e3), "", ordered="tau") for i in (1, 2)
    ]
    prior, rng = Prior(times, minimum_ratio=1.0), np.random.default_rng(3)
    found, open_end = np.exp(1e-3 * NORMAL), rng.uniform(0.0, np.log(1e3), NORMAL.size)
    larger = np.stack([np.exp(-open_end), found], axis=1)
    # As normal scores: of a uniform's lower half, and of the smaller of two uniforms.
    quantiles = np.array([0.16, 0.84])
    after, before = (np.ptp(ndtri(u)) for u in (0.5 * quantiles, 1.0 - np.sqrt(1.0 - quantiles)))
    left = 1.0 - (after / before) ** 2
    assert told(prior, larger) == pytest.approx([left, 1.0], abs=0.03)
    smaller = np.stack([found, np.exp(open_end)], axis=1)
    assert told(prior, smaller) == pytest.approx([1.0, left], abs=0.03)


def test_contractions_of_correlated_inherited_parameters_are_their_own():
    pair = [Parameter(name, "", "1", "", LogNormal(1.0, 1.0), "") for name in "ab"]
    rng = np.random.default_rng(4)
    tie = np.array([[1.0, 0.0], [0.95, np.sqrt(1.0 - 0.95**2)]])
    prior = Prior(pair).inherit(("a", "b"), np.exp(rng.standard_normal((20000, 2)) @ tie.T))
    z = rng.standard_normal((20000, 2))
    known_a = np.exp(np.stack([0.01 * z[:, 0], 0.95 * 0.01 * z[:, 0] + tie[1, 1] * z[:, 1]], 1))
    assert told(prior, known_a) == pytest.approx([1.0, 0.95**2], abs=0.02)
    # Only the ratio that a and b leave open is found: neither is known better for it.
    ratio = np.exp(np.stack([z[:, 0], 0.95 * z[:, 0] + 0.01 * tie[1, 1] * z[:, 1]], axis=1))
    assert told(prior, ratio) == pytest.approx([0.0, 1.0 - 0.95**2], abs=0.05)


def test_a_proposal_far_outside_the_prior_fails_without_a_warning():
    target = tubular().target(2)
    z = np.zeros((3, target.dimension))
    z[1] = 900.0
    z[2] = -900.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = target.log_likelihood_of_normal(z)
    assert np.isfinite(values).tolist() == [True, False, False]
