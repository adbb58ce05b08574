"""Bands, densities and scores of records; draws that have no response."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import lognorm, norm

import deabayes
from deabayes.experiment import Excitation, Experiment, Quantity, Specimen
from deabayes.noise.white import White
from deabayes.prediction.bands import Samples, sample_response, to_dataset
from deabayes.prediction.errors import error_row
from deabayes.prediction.noise_origin import NoiseOrigin
from deabayes.systems.membrane.system import Membrane

TIME = np.array([0.0, 1.0, 2.0, 4.0])
SIGMA = 0.2


class Constant:
    """y(t) = level; without a response where that is negative."""

    def simulator_of(self, experiment):
        return lambda draws: self.level(draws) * np.ones(experiment.coordinate.size)

    def level(self, draws):
        level = draws["level"][:, None]
        return np.where(level < 0.0, np.nan, level)

    def failure_note(self, excitation, coordinate, draws):
        return "negative"


def record(response=(2.0, 2.1, 1.7, 2.4), averaged=1.0):
    return Experiment(
        "a", "step", "validate", "time", "s", TIME, "force", "N", np.asarray(response, float),
        np.broadcast_to(averaged, TIME.shape).astype(float),
        Excitation("voltage", "V", np.array([0.0, 4.0]), np.array([0.0, 8.0])),
    )  # fmt: skip


def sampled(levels, experiment, sigma=SIGMA, **origin):
    levels = np.asarray(levels, float)
    noise = {"sigma_white": np.broadcast_to(sigma, levels.shape).astype(float)}
    return sample_response(
        Constant(), White(), {"level": levels}, noise, experiment, NoiseOrigin("step", **origin),
        TIME, np.random.default_rng(1),
    )  # fmt: skip


def test_a_mean_of_many_readings_has_that_much_less_noise():
    averaged = np.array([1.0, 4.0, 100.0, 2.0])
    what = record(averaged=averaged)
    found = sampled(np.full(4000, 2.0), what)
    sd = SIGMA / np.sqrt(averaged)
    np.testing.assert_allclose((found.predictive - 2.0).std(axis=0), sd, rtol=0.05)
    expected = norm(2.0, sd).logpdf(what.response).sum()
    np.testing.assert_allclose(found.log_density, expected, rtol=1e-12)
    np.testing.assert_allclose(found.pit, norm(2.0, sd).cdf(what.response), rtol=1e-12)


def test_the_density_is_one_of_the_response_in_its_unit():
    """A residual relative to the scale 3 N, and one of the logarithm."""
    what = record()
    wide = sampled([2.0, 2.2], what, scale=3.0).log_density
    expected = [norm(level, 3.0 * SIGMA).logpdf(what.response).sum() for level in (2.0, 2.2)]
    np.testing.assert_allclose(wide, expected, rtol=1e-12)
    ratio = sampled([2.0, 2.2], what, proportional=True).log_density
    expected = [lognorm(SIGMA, scale=level).logpdf(what.response).sum() for level in (2.0, 2.2)]
    np.testing.assert_allclose(ratio, expected, rtol=1e-12)


def test_a_draw_keeps_its_own_noise_where_others_fail():
    what = record()
    found = sampled([-1.0, 2.0, 2.2], what, sigma=[9.0, 0.1, 0.3])
    expected = [norm(m, s).logpdf(what.response).sum() for m, s in ((2.0, 0.1), (2.2, 0.3))]
    np.testing.assert_allclose(found.log_density, [-np.inf, *expected], rtol=1e-12)
    assert found.failed == 1 and found.failure == "1 of 3 draws have no response (negative)"


def test_bands_leave_the_same_share_on_either_side():
    """Of 0, 1, ..., 100: 25 to 75 and 5 to 95; the mean and median of a skewed sample differ."""
    experiment = record()
    dataset = to_dataset(experiment, sampled(range(101), experiment), {"candidate": "one"})
    at = dataset.sel(coordinate=1.0)
    for name in ("parameter", "discrepancy"):  # the same without correlated noise
        np.testing.assert_allclose(at[name], [[25.0, 75.0], [5.0, 95.0]])
    np.testing.assert_allclose(at["predictive"], [[24.75, 75.25], [4.55, 95.45]], atol=0.5)
    skewed = to_dataset(experiment, sampled([0.0, 1.0, 5.0], experiment), {})
    np.testing.assert_allclose(skewed["parameter"][..., 0], [[0.5, 3.0], [0.1, 4.6]])
    assert (float(skewed["mean"][0]), float(skewed["median"][0])) == (2.0, 1.0)
    assert dataset["level"].values.tolist() == [0.5, 0.9]
    np.testing.assert_allclose(dataset["excitation"], [0.0, 2.0, 4.0, 8.0])
    assert dataset["observed"].attrs["units"] == "N"
    assert dataset.attrs["candidate"] == "one"


def test_a_row_of_errors_by_hand():
    """Curves 0, 1, ..., 20 against readings about 10, whose range is 4."""
    what = replace(record(), response=np.array([8.0, 10.0, 10.0, 12.0]))
    levels = np.arange(21.0)[:, None] * np.ones(TIME.size)
    noisy = np.linspace(9.0, 15.0, 601)[:, None] * np.ones(TIME.size)
    ends = np.array([[10.5, 13.5], [9.3, 14.7]])[..., None] * np.ones(TIME.size)
    made = Samples(
        levels, levels, noisy, {"predictive": ends}, np.log([0.2, 0.4]), np.full(TIME.size, 0.5), 3
    )
    row = error_row(what, made, "too far")
    assert row["e_rms_percent"] == pytest.approx(100 * np.sqrt(2.0) / 4)
    assert row["e_m_percent"] == pytest.approx(100 * 2.0 / 4)
    # Of |level - 10| + 2, twice each but the first: 2, 3, 3, ..., 12, 12; ranks 1 and 19.
    assert (row["e_m_q05"], row["e_m_q95"]) == pytest.approx((100 * 3 / 4, 100 * 12 / 4))
    rms = [100 * np.sqrt(2.0 + off**2) / 4 for off in (1.0, 10.0)]
    assert (row["e_rms_q05"], row["e_rms_q95"]) == pytest.approx(rms)
    assert (row["coverage_50"], row["coverage_90"]) == (0.25, 0.75)
    assert row["joint_log_score"] == pytest.approx(np.log(0.3))
    assert row["joint_log_score_draws"] == pytest.approx(0.36 / 0.2)
    assert row["failed_draws"] == 3 and row["extrapolation"] == "too far"
    assert (row["experiment"], row["role"], row["protocol"]) == ("a", "validate", "step")


def test_a_record_that_the_draws_were_not_fitted_to_is_learned_from_point_by_point():
    """Whatever the study calls it: a population's new specimen has seen no record."""
    what = replace(record(), role="calibrate")
    levels = np.linspace(1.5, 2.5, 200)
    noise = {"sigma_white": np.full(levels.shape, SIGMA)}
    given = Constant(), White(), {"level": levels}, noise, what, NoiseOrigin("step"), TIME
    unseen, seen = (
        sample_response(*given, np.random.default_rng(1), known).pit for known in (False, True)
    )
    each = norm(levels[:, None], SIGMA).cdf(what.response)
    np.testing.assert_allclose(seen, each.mean(axis=0))
    assert unseen[0] == pytest.approx(seen[0])
    weights = norm(levels, SIGMA).pdf(what.response[0])
    assert unseen[1] == pytest.approx(each[:, 1] @ weights / weights.sum())


def test_a_record_that_does_not_vary_has_no_relative_errors():
    what = replace(record(), response=np.full(TIME.size, 2.0))
    row = error_row(what, sampled([1.9, 2.0, 2.1], what), "")
    assert np.isnan(
        [row["e_rms_percent"], row["e_rms_q05"], row["e_m_percent"], row["e_m_q95"]]
    ).all()
    assert 0.0 <= row["coverage_90"] <= 1.0 and np.isfinite(row["crps"])


SPECIMEN = Specimen(
    "m", "membrane", {"kind": "simulated"},
    {
        "thickness": Quantity(1e-3, "m"), "permittivity": Quantity(4.11e-11, "F/m"),
        "prestretch": Quantity(3.0, "1"), "side_length": Quantity(0.01, "m"),
    },
)  # fmt: skip
RAMP_TIME = np.linspace(0.0, 600.0, 61)
RAMP = 5e3 * RAMP_TIME / 600.0
MATERIAL = {
    "zeta_alpha": 1e5, "J_beta": 55.0, "mu_beta_1": 15e3, "tau_beta_1": 4.0, "mu_alpha": 35e3,
}  # fmt: skip
STABLE, UNSTABLE = 110.0, 1e6


def ramp_response(limits, observed=np.nan):
    """A ramp to 5 kV in 600 s, for draws of J_alpha; with J -> infinity it ends at 3.75 kV."""
    draws = {name: np.full(len(limits), value) for name, value in MATERIAL.items()}
    draws["J_alpha"] = np.asarray(limits)
    experiment = Experiment(
        "ramp", "step", "validate", "time", "s", RAMP_TIME, "stretch", "1",
        np.broadcast_to(observed, RAMP_TIME.shape), np.ones(RAMP_TIME.size),
        Excitation("voltage", "V", RAMP_TIME, RAMP), provenance="simulated",
    )  # fmt: skip
    noise = {"sigma_white": np.full(len(limits), 1e-3)}
    samples = sample_response(
        Membrane("kv_gm_1", SPECIMEN), White(), draws, noise, experiment,
        NoiseOrigin("step", 1.0), RAMP_TIME, np.random.default_rng(1),
    )  # fmt: skip
    return experiment, samples


def test_draws_past_pull_in_are_left_out_and_the_voltage_is_named():
    _, samples = ramp_response([STABLE, STABLE, UNSTABLE])
    assert samples.parameter.shape == (2, RAMP_TIME.size)
    assert samples.failed == 1
    assert samples.failure.startswith("1 of 3 draws have no response (pull-in; at ")
    kilovolts = float(samples.failure.split("under ")[1].split(" kV")[0])
    assert 3.75 < kilovolts < 4.3  # the fold, and what viscosity delays


def test_bands_are_nan_if_every_draw_fails():
    experiment, samples = ramp_response([UNSTABLE, UNSTABLE])
    dataset = to_dataset(experiment, samples, {})
    assert np.isnan(dataset["predictive"].values).all()
    assert dataset.attrs["failed_draws"] == 2
    assert "pull-in" in dataset.attrs["failure"]


def test_simulate_gives_the_reason_of_a_failure():
    found = deabayes.simulate(
        "membrane", "kv_gm_1", {**MATERIAL, "J_alpha": UNSTABLE},
        {"thickness": 1e-3, "permittivity": 4.11e-11, "prestretch": 3.0, "side_length": 0.01},
        time=RAMP_TIME, voltage=RAMP,
    )  # fmt: skip
    assert "pull-in" in found.attrs["failure"]
    assert "kV" in found.attrs["failure"]


def scored(limits):
    """The row of errors.csv of a record that reads what the stable draw gives, with noise."""
    experiment, samples = ramp_response([STABLE])
    read = samples.parameter[0] + 1e-3 * np.random.default_rng(2).standard_normal(RAMP_TIME.size)
    _, samples = ramp_response(limits, read)
    return error_row(replace(experiment, response=read), samples, "")


def test_draws_without_a_response_cost_joint_log_score():
    whole, few = scored([STABLE] * 20), scored([STABLE] * 2 + [UNSTABLE] * 18)
    assert few["failed_draws"] == 18
    assert few["joint_log_score"] == pytest.approx(whole["joint_log_score"] + np.log(0.1))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("limits", [[STABLE, UNSTABLE], [UNSTABLE, UNSTABLE]])
def test_scores_of_bands_need_two_draws(limits):
    row = scored(limits)
    assert all(np.isnan(row[name]) for name in ("crps", "coverage_50", "coverage_90"))
    left = limits.count(STABLE)
    assert np.isnan(row["e_rms_percent"]) == (left == 0)
    assert np.isfinite(row["joint_log_score"]) == (left == 1)
