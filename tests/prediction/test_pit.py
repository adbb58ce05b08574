"""Probability integral transforms of records: uniform if model and noise are right, else not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.lines import Line2D
from scipy.special import ndtr
from scipy.stats import kstest, kstwo
from tests.prediction.test_noise_origin import NOISE_DRAWS, TIME, fitted, record
from tests.shared.fake_records import Fake
from tests.shared.fake_results import write_study

from deabayes import figures
from deabayes.figures import pit as pit_figure
from deabayes.figures.results import StudyResults
from deabayes.prediction.bands import to_dataset
from deabayes.prediction.errors import error_row, uniformity_p
from deabayes.prediction.outcomes import transforms


def noisy(seed, factor=1.0):
    """A held-out record with noise of the fitted law, its size multiplied."""
    drawn = fitted().noise.sample(
        np.random.default_rng(seed), TIME, np.ones(TIME.size),
        {n.split(".")[1]: np.array([v]) for n, v in NOISE_DRAWS.items()},
    )  # fmt: skip
    clean = record(2e3)
    return replace(clean, response=clean.response + factor * (drawn[0] + drawn[1])[0])


def sampled(what):
    return fitted().sample(what, np.random.default_rng(1))


def test_pit_is_that_of_the_innovations():
    what, found = noisy(1), fitted()
    residuals = (what.response - record(2e3).response)[None]
    noise = {n.split(".")[1]: np.array([v]) for n, v in NOISE_DRAWS.items()}
    scores = found.noise.innovations(residuals, TIME, np.ones(TIME.size), noise)
    np.testing.assert_allclose(sampled(what).pit, ndtr(scores[0]), rtol=1e-6)


def two_sizes(what):
    """Halves of draws, the second with three times the noise; samples of all and of each."""
    found = fitted()
    sigma = found.draws["step.sigma_ou"] * np.where(np.arange(400) < 200, 1.0, 3.0)
    both = replace(found, draws={**found.draws, "step.sigma_ou": sigma})
    halves = [
        replace(found, draws={n: v[half] for n, v in both.draws.items()})
        for half in (slice(200), slice(200, None))
    ]
    return halves, [each.sample(what, np.random.default_rng(1)) for each in (both, *halves)]


def test_pit_of_a_fitted_record_is_averaged_over_draws():
    _, (both, *parts) = two_sizes(replace(noisy(1), name=record(4e3).name))
    np.testing.assert_allclose(both.pit, np.mean([p.pit for p in parts], axis=0), rtol=1e-12)
    assert not np.allclose(parts[0].pit, parts[1].pit)


def test_points_of_a_held_out_record_update_the_weights_of_draws():
    """Each half weighs what the points before gave it: equal at first, all for the right one."""
    halves, (mixed, right, wrong) = two_sizes(what := noisy(1))
    assert mixed.pit[0] == pytest.approx(0.5 * (right.pit[0] + wrong.pit[0]), rel=1e-9)
    residuals = (what.response - record(2e3).response)[None]
    total = np.zeros(1)
    for half, sign in zip(halves, (1.0, -1.0), strict=True):
        noise = {n.split(".")[1]: half.draws[n][:1] for n in NOISE_DRAWS}
        each = half.noise.pointwise_log_prob(residuals, TIME, np.ones(TIME.size), noise)
        total = total + sign * (np.cumsum(each[0]) - each[0])
    share = 1.0 / (1.0 + np.exp(-total))
    assert share[0] == 0.5 and share[-1] > 1.0 - 1e-6
    np.testing.assert_allclose(mixed.pit, share * right.pit + (1 - share) * wrong.pit, rtol=1e-5)


@pytest.mark.parametrize(("factor", "least", "most"), [(1.0, 0.01, 1.0), (2.0, 0.0, 1e-3),
                                                       (0.5, 0.0, 1e-3)])  # fmt: skip
def test_noise_of_another_size_is_not_uniform(factor, least, most):
    rows = [error_row(what, sampled(what), "") for what in (noisy(k, factor) for k in range(3))]
    assert all(least <= row["pit_p"] <= most for row in rows)


def test_the_file_stores_pit_and_a_prediction_has_none():
    what = noisy(1)
    samples = sampled(what)
    kept = to_dataset(what, samples, {})
    np.testing.assert_array_equal(kept["pit"], samples.pit)
    asked = replace(what, response=np.full(TIME.size, np.nan))
    assert np.isnan(to_dataset(asked, sampled(asked), {})["pit"]).all()


def test_p_of_uniformity_by_hand():
    # One point at 0.9: the larger step is 0.9, P(D >= 0.9) = 2 * 0.1.
    assert uniformity_p([0.9]) == pytest.approx(0.2)
    assert np.isnan(uniformity_p([np.nan, 0.5]))


@pytest.mark.parametrize("size", [20, 200, 2000])
def test_p_of_uniformity_is_the_exact_one(size):
    rng = np.random.default_rng(size)
    for power in (0.8, 1.0, 1.1, 1.3):
        pit = rng.uniform(size=size) ** power
        exact = kstest(pit, "uniform").pvalue
        assert uniformity_p(pit) == pytest.approx(exact, abs=1e-4 if exact < 0.1 else 1e-3)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    fake = Fake(candidates=(1,))
    return write_study(tmp_path_factory.mktemp("results"), fake)


def test_the_figure_names_the_records_that_leave_the_band(study):
    study = StudyResults(study)
    (figure,) = figures.draw("pit", study.recommended)
    (legend,) = figure.legends
    predictions = study.recommended.predictions
    far = {name for name, p in predictions.items() if uniformity_p(p["pit"]) < 0.05}
    assert {n for n, e in study.experiments.items() if e.role == "validate"} < far
    assert {text.get_text() for text in legend.get_texts()} == {"others", *far}
    for ax in figure.axes:
        low, high = ax.get_ylim()
        assert all(low < np.min(y) and np.max(y) < high for y in map(Line2D.get_ydata, ax.lines))


@pytest.mark.parametrize("size", [4, 9, 40, 2000])
def test_the_figure_and_the_table_agree_on_what_leaves(study, size):
    """Slightly below and above the limit of p = 0.05; for few points the root of n is inexact."""
    results = StudyResults(study).recommended
    name, prediction = next(iter(results.predictions.items()))
    results.predictions.clear()
    uniform = (np.arange(size) + 0.5) / size
    for shift in np.linspace(0.0, 0.7, 6) / np.sqrt(size) + kstwo.isf(0.05, size) - 0.5 / size:
        for factor in (0.999, 1.001):
            pit = np.clip(uniform + factor * shift, 0.0, 1.0)
            changed = prediction.drop_vars("pit").assign(pit=("point", pit))
            results.predictions[name] = changed
            (line,) = pit_figure._departures(results, "calibrate").values()
            assert pit_figure._leaves(line) == (uniformity_p(pit) < 0.05)


def test_old_results_without_pit_have_no_figure(study):
    results = StudyResults(study).recommended
    for name, prediction in list(results.predictions.items()):
        results.predictions[name] = prediction.drop_vars("pit")
    assert figures.draw("pit", results) == []


CALIBRATED, HELD_OUT, DRAWS = 100, 1000, 250


def held_out(rng, draws=DRAWS):
    """Scores and log densities (S, N) of a level, known from 100 readings with noise of sd 1."""
    levels = rng.normal(size=draws) / np.sqrt(CALIBRATED)
    truth = rng.normal() / np.sqrt(CALIBRATED)
    scores = truth + rng.normal(size=HELD_OUT) - levels[:, None]
    return scores, -0.5 * scores**2


def share_rejected(weighted, repeats=100):
    """Share of right models that a test of the 5 % level calls wrong."""
    rng = np.random.default_rng(8)
    found = []
    for _ in range(repeats):
        scores, log_density = held_out(rng)
        found.append(uniformity_p(transforms(scores, log_density if weighted else None)))
    return np.mean(np.array(found) < 0.05)


def test_a_right_model_is_rejected_as_often_as_the_test_says():
    assert share_rejected(weighted=True) <= 0.11
    # With equal weights the level's one error counts at all thousand points.
    assert share_rejected(weighted=False) > 0.4


def test_weights_stay_where_too_few_draws_would_be_left():
    scores, log_density = held_out(np.random.default_rng(9))
    log_density[7, 500:] += 100.0  # from point 501 on, one draw alone
    found = transforms(scores, log_density)
    cut = transforms(scores[:, :501], log_density[:, :501])
    np.testing.assert_array_equal(found[:501], cut)
    before = np.sum(log_density[:, :500], axis=1)
    weights = np.exp(before - before.max())
    assert np.sum(weights) ** 2 / np.sum(weights**2) > 20.0
    alone = transforms(scores[7:8])
    assert np.abs(found[501:] - alone[501:]).max() > 0.01


def test_draws_without_a_density_do_not_count():
    scores, log_density = held_out(np.random.default_rng(10), draws=50)
    scores[3, 2] = np.nan
    log_density[4, 5] = -np.inf
    left = np.delete(np.arange(50), [3, 4])
    np.testing.assert_allclose(
        transforms(scores, log_density), transforms(scores[left], log_density[left])
    )
    assert np.isnan(transforms(np.full((2, 4), np.nan))).all()


@pytest.mark.parametrize("draws", [1, 2])
def test_one_or_two_draws_suffice(draws):
    scores, log_density = held_out(np.random.default_rng(11), draws=draws)
    assert np.isfinite(transforms(scores, log_density)).all()
