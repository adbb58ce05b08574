"""Probability integral transforms of records: uniform if the noise's law holds, and only then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
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


def test_it_is_that_of_the_innovations():
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


def test_it_is_averaged_over_draws_that_have_seen_the_record():
    _, (both, *parts) = two_sizes(replace(noisy(1), name=record(4e3).name))
    np.testing.assert_allclose(both.pit, np.mean([p.pit for p in parts], axis=0), rtol=1e-12)
    assert not np.allclose(parts[0].pit, parts[1].pit)


def test_a_held_out_record_tells_of_the_draws_as_it_goes():
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


def test_the_file_keeps_it_and_a_prediction_has_none():
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


def test_the_figure_names_the_records_that_leave_the_band(tmp_path):
    study = StudyResults(write_study(tmp_path, Fake(candidates=(1,))))
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
def test_the_figure_and_the_table_agree_on_what_leaves(tmp_path, size):
    """At the limit of p = 0.05, a hair to either side; of few points the root of n is not all."""
    folder = write_study(tmp_path, Fake(candidates=(1,), protocols=("relaxation",)))
    results = StudyResults(folder).recommended
    ((name, prediction),) = results.predictions.items()
    uniform = (np.arange(size) + 0.5) / size
    for shift in np.linspace(0.0, 0.7, 15) / np.sqrt(size) + kstwo.isf(0.05, size) - 0.5 / size:
        for factor in (0.999, 1.001):
            pit = np.clip(uniform + factor * shift, 0.0, 1.0)
            changed = prediction.drop_vars("pit").assign(pit=("point", pit))
            results.predictions[name] = changed
            (line,) = pit_figure._departures(results, "calibrate").values()
            assert pit_figure._leaves(line) == (uniformity_p(pit) < 0.05)


def test_results_from_before_have_no_such_figure(tmp_path):
    folder = write_study(tmp_path, Fake(candidates=(1,)))
    for path in folder.glob("*/predictions/*.nc"):
        old = xr.load_dataset(path, engine="h5netcdf").drop_vars("pit")
        old.to_netcdf(path, engine="h5netcdf")
    assert figures.draw("pit", StudyResults(folder).recommended) == []
