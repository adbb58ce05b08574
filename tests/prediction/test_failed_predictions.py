"""Draws that have no response: left out, counted, and said why, when and at which voltage."""

from dataclasses import replace

import numpy as np
import pytest

import deabayes
from deabayes.experiment import Excitation, Experiment, Quantity, Specimen
from deabayes.noise.white import White
from deabayes.prediction.bands import NoiseOrigin, sample_response, to_dataset
from deabayes.prediction.errors import error_row
from deabayes.systems.membrane.system import Membrane

SPECIMEN = Specimen(
    "m", "membrane", {"kind": "simulated"},
    {
        "thickness": Quantity(1e-3, "m"), "permittivity": Quantity(4.11e-11, "F/m"),
        "prestretch": Quantity(3.0, "1"), "side_length": Quantity(0.01, "m"),
    },
)  # fmt: skip
TIME = np.linspace(0.0, 600.0, 61)
RAMP = 5e3 * TIME / 600.0
MATERIAL = {
    "zeta_alpha": 1e5, "J_beta": 55.0, "mu_beta_1": 15e3, "tau_beta_1": 4.0, "mu_alpha": 35e3,
}  # fmt: skip
STABLE, UNSTABLE = 110.0, 1e6


def response(limits, observed=np.nan):
    """A ramp to 5 kV in 600 s, for draws of J_alpha; with J -> infinity it ends at 3.75 kV."""
    draws = {name: np.full(len(limits), value) for name, value in MATERIAL.items()}
    draws["J_alpha"] = np.asarray(limits)
    experiment = Experiment(
        "ramp", "step", "validate", "time", "s", TIME, "stretch", "1",
        np.broadcast_to(observed, TIME.shape), np.ones(TIME.size),
        Excitation("voltage", "V", TIME, RAMP), provenance="simulated",
    )  # fmt: skip
    noise = {"sigma_white": np.full(len(limits), 1e-3)}
    samples = sample_response(
        Membrane("kv_gm_1", SPECIMEN), White(), draws, noise, experiment,
        NoiseOrigin("step", 1.0), TIME, np.random.default_rng(1),
    )  # fmt: skip
    return experiment, samples


def test_draws_past_pull_in_are_left_out_and_the_voltage_is_said():
    _, samples = response([STABLE, STABLE, UNSTABLE])
    assert samples.parameter.shape == (2, TIME.size)
    assert samples.failed == 1
    assert samples.failure.startswith("1 of 3 draws have no response (pull-in; at ")
    kilovolts = float(samples.failure.split("under ")[1].split(" kV")[0])
    assert 3.75 < kilovolts < 4.3  # the fold, and what viscosity delays


def test_where_no_draw_is_left_the_bands_are_nan_and_nothing_breaks():
    experiment, samples = response([UNSTABLE, UNSTABLE])
    dataset = to_dataset(experiment, samples, {})
    assert np.isnan(dataset["predictive"].values).all()
    assert dataset.attrs["failed_draws"] == 2
    assert "pull-in" in dataset.attrs["failure"]


def test_simulate_says_why():
    found = deabayes.simulate(
        "membrane", "kv_gm_1", {**MATERIAL, "J_alpha": UNSTABLE},
        {"thickness": 1e-3, "permittivity": 4.11e-11, "prestretch": 3.0, "side_length": 0.01},
        time=TIME, voltage=RAMP,
    )  # fmt: skip
    assert "pull-in" in found.attrs["failure"]
    assert "kV" in found.attrs["failure"]


def scored(limits):
    """The row of errors.csv of a record that reads what the stable draw gives, with noise."""
    experiment, samples = response([STABLE])
    read = samples.parameter[0] + 1e-3 * np.random.default_rng(2).standard_normal(TIME.size)
    _, samples = response(limits, read)
    return error_row(replace(experiment, response=read), samples, "")


def test_draws_without_a_response_cost_joint_log_score():
    whole, few = scored([STABLE] * 20), scored([STABLE] * 2 + [UNSTABLE] * 18)
    assert few["failed_draws"] == 18
    assert few["joint_log_score"] == pytest.approx(whole["joint_log_score"] + np.log(0.1))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("limits", [[STABLE, UNSTABLE], [UNSTABLE, UNSTABLE]])
def test_one_draw_is_no_distribution(limits):
    row = scored(limits)
    assert all(np.isnan(row[name]) for name in ("crps", "coverage_50", "coverage_90"))
    left = limits.count(STABLE)
    assert np.isnan(row["e_rms_percent"]) == (left == 0)
    assert np.isfinite(row["joint_log_score"]) == (left == 1)
