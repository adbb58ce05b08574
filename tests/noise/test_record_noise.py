"""Noise of records: what a group must have in common, and the scale of residuals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import lognorm, norm

from deabayes.experiment import Excitation, Experiment, Quantity
from deabayes.faults import UserError
from deabayes.inference.record_noise import ResidualScale, noise_parameters
from deabayes.noise import REGISTRY
from deabayes.prior.distributions import LogNormal
from deabayes.study import Study

STUDY = Study("mixed", Path("data"), ("ogden_1",), noise_scale="range")
SYSTEM = SimpleNamespace(
    proportional=(),
    responses={"force": "N", "displacement": "m"},
    specimen=SimpleNamespace(instruments={"force.noise": Quantity(1e-3, "N")}),
)


def rising(name, driven, response, read):
    coordinate = np.linspace(0.0, driven[2], read.size)
    return Experiment(
        name, "quasi_static", "calibrate", driven[0], driven[1], coordinate, *response, read,
        np.ones(read.size), Excitation(*driven[:2], coordinate, coordinate),
    )  # fmt: skip


PULL = rising("pull", ("displacement", "m", 0.02), ("force", "N"), np.linspace(0.0, 0.1, 40))
RAISED = rising("raised", ("voltage", "V", 5e3), ("force", "N"), np.linspace(0.0, 0.1, 40))
BENT = rising("bent", ("voltage", "V", 5e3), ("displacement", "m"), np.linspace(0.0, 2e-3, 40))


def parameters(*experiments, noise="ornstein_uhlenbeck", **changes):
    made = noise_parameters(replace(STUDY, **changes), REGISTRY[noise](), experiments, SYSTEM)
    return {parameter.name: parameter for parameter in made}


def test_one_correlation_length_does_not_serve_two_units():
    with pytest.raises(UserError, match=r"coordinates in V and m\. They cannot share the length"):
        parameters(PULL, RAISED)
    assert parameters(PULL, RAISED, noise="white")
    assert parameters(PULL, RAISED, noise_coordinate="grid")
    apart = parameters(PULL, RAISED, noise_groups="experiment")
    assert (apart["pull.tau_ou"].unit, apart["raised.tau_ou"].unit) == ("m", "V")


@pytest.mark.parametrize("order", [[RAISED, BENT], [BENT, RAISED]])
def test_a_sensors_noise_is_not_the_prior_of_two_sensors(order):
    one = parameters(RAISED)["quasi_static.sigma_white"]
    assert one.prior == LogNormal(1e-3 / 0.1, 0.4) and "specimen.yaml" in one.source
    both = parameters(*order)["quasi_static.sigma_white"]
    assert both.prior == parameters(BENT)["quasi_static.sigma_white"].prior
    assert "specimen.yaml" not in both.source


def test_noise_without_a_white_part_refuses_repeated_coordinates():
    again = replace(PULL, coordinate=np.repeat(PULL.coordinate[:20], 2))
    with pytest.raises(UserError, match=r"record pull: 20 readings repeat their displacement \(th"):
        parameters(again, noise="ar1")
    assert parameters(again) and parameters(again, noise="ar1", noise_coordinate="grid")
    assert parameters(PULL, noise="ar1")


MEAN = np.array([[1.0, 2.0, 5.0], [1.5, 2.5, 4.0]])
RESPONSE = np.array([1.1, 1.9, 5.5])


@pytest.mark.parametrize("scale", [1.0, 0.2, np.array([0.3, 2.0])])
@pytest.mark.parametrize("proportional", [False, True])
def test_a_response_comes_back_from_its_residuals(scale, proportional):
    found = ResidualScale(scale, proportional)
    residuals = found.residuals(RESPONSE, MEAN)
    again = found.with_residuals(MEAN, residuals)
    np.testing.assert_allclose(again, np.broadcast_to(RESPONSE, MEAN.shape), rtol=1e-14)


def test_differences():
    found = ResidualScale(0.5).residuals(RESPONSE, MEAN)
    np.testing.assert_allclose(found, 2.0 * (RESPONSE - MEAN))


def test_the_density_is_that_of_the_response():
    """r standard normal makes y normal about f, or log-normal with median f."""
    for proportional in (False, True):
        scale = np.array([0.3, 2.0])
        found = ResidualScale(scale, proportional)
        density = norm.logpdf(found.residuals(RESPONSE, MEAN)) + found.log_derivative(RESPONSE)
        if proportional:
            expected = lognorm.logpdf(RESPONSE, scale[:, None], scale=MEAN)
        else:
            expected = norm.logpdf(RESPONSE, MEAN, scale[:, None])
        np.testing.assert_allclose(density, expected, rtol=1e-12)


def test_a_gain_that_is_not_positive_has_no_residual():
    bad = np.array([[1.0, -2.0, 0.0]])
    found = ResidualScale(proportional=True).residuals(RESPONSE, bad)
    assert np.isnan(found[0, 1]) and not np.isfinite(found[0, 2])
