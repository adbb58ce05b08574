"""Ogden terms of which a record shows the sum: what stays put where one of them is hidden."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.shared.coordinates import check_there_and_back, coordinates_of, parts_of
from tests.validation.worlds import blank

from deabayes.experiment import Excitation, Experiment, FloatArray, Specimen
from deabayes.inference.log_posterior import LogPosterior, build
from deabayes.study import Settings, Study
from deabayes.systems.ridges.units import Shares
from deabayes.systems.tensile_strip.system import TensileStrip

STRIP = Specimen("strip", "tensile_strip", {"kind": "simulated"}, {})
TO = 4.0


def pulled(deformation: str = "uniaxial", to: float = TO) -> Experiment:
    stretch = np.linspace(1.0, to, 30)
    held = {"protocol": "quasi_static", "deformation": deformation}
    excitation = Excitation("stretch", "1", stretch, stretch, held)
    channels = ("nominal_stress", "Pa"), ("stretch", "1")
    return blank(
        deformation, "quasi_static", channels[0], stretch, excitation, "calibrate", channels[1]
    )


def target(candidate: str, priors: dict[str, Settings] | None = None) -> LogPosterior:
    study = Study("study", Path(), (candidate,), priors=priors or {})
    return build(study, candidate, STRIP, [pulled()])


def shares_of(posterior: LogPosterior) -> list[Shares]:
    return parts_of(posterior, Shares)


def at(posterior: LogPosterior, **terms: float) -> FloatArray:
    """u of a spring, the noise as in the prior's middle."""
    theta = posterior.prior.to_parameters(np.zeros((1, posterior.dimension)))
    for name, value in terms.items():
        theta[:, posterior.names.index(name)] = value
    return coordinates_of(posterior).straighten(posterior.prior.to_normal(theta))[0][0]


@pytest.mark.parametrize("candidate", ["ogden_2", "ogden_3"])
def test_there_and_back_with_the_jacobian(candidate: str) -> None:
    posterior = target(candidate)
    assert len(shares_of(posterior)) == 1
    z = np.random.default_rng(1).standard_normal((100, posterior.dimension))
    check_there_and_back(coordinates_of(posterior), z)


def test_what_adds_up_is_the_stress_at_the_largest_stretch() -> None:
    posterior = target("ogden_3")
    (shares,) = shares_of(posterior)
    z = np.random.default_rng(2).standard_normal((50, posterior.dimension))
    draws = posterior.draws(posterior.prior.to_parameters(z))
    excitation = pulled().excitation
    strip = TensileStrip("ogden_3", STRIP)
    stress = strip.simulator(excitation, np.array([1.0, TO]), "nominal_stress")(draws)[:, 1]
    u, _ = coordinates_of(posterior).straighten(z)
    np.testing.assert_allclose(np.exp(u[:, shares.sizes[0]]), TO * stress)
    mu, alpha = (np.array([draws[f"{name}_{i}"] for i in (1, 2, 3)]) for name in ("mu", "alpha"))
    parts = mu * (TO**alpha - TO ** (-alpha / 2.0)) / (TO * stress)
    mean = 2.5 + 15.0 / np.sqrt(12.0) * u[:, shares.places[0]]
    np.testing.assert_allclose(mean, (parts * alpha).sum(axis=0))


def test_a_hidden_term_moves_neither_stress_nor_mean_exponent() -> None:
    """One term of 50 kPa and 3, and one that hardly is: below it, above it, or sharing it."""
    posterior = target("ogden_2")
    (shares,) = shares_of(posterior)
    alone = {"mu_2": 50e3, "alpha_2": 3.0, "mu_1": 1e-3, "alpha_1": 0.5}
    seen = at(posterior, **alone)
    above = at(posterior, mu_1=50e3, alpha_1=3.0, mu_2=1e-6, alpha_2=5.0)
    both = at(posterior, mu_1=20e3, alpha_1=2.98, mu_2=30e3, alpha_2=3.01)
    for other in (above, both):
        assert other[shares.sizes[0]] == pytest.approx(seen[shares.sizes[0]], abs=0.01)
        assert other[shares.places[0]] == pytest.approx(seen[shares.places[0]], abs=0.01)
    assert above[shares.sizes[1]] < -15.0 < 15.0 < seen[shares.sizes[1]]


def test_an_exponent_near_zero_is_that_of_a_logarithm() -> None:
    posterior = target("ogden_2")
    below, zero, above = (
        at(posterior, mu_1=-1e5, alpha_1=-1.0, mu_2=5e4 / alpha, alpha_2=alpha)
        for alpha in (-1e-7, 1e-12, 1e-7)
    )
    np.testing.assert_allclose(below, zero, atol=1e-5)
    np.testing.assert_allclose(above, zero, atol=1e-5)


def test_the_record_in_which_principal_stretches_differ_most() -> None:
    strip = TensileStrip("ogden_2", STRIP)
    records = [pulled("uniaxial", 4.0), pulled("equibiaxial", 3.0), pulled("pure_shear", 2.0)]
    assert strip.largest_stretches(records) == pytest.approx((3.0, 1.0 / 9.0))
    assert strip.largest_stretches([pulled("uniaxial", 0.4)]) == pytest.approx((0.4, 0.4**-0.5))
    assert strip.largest_stretches([pulled(to=1.0)]) is None


def test_terms_that_cannot_be_added_stay_as_they_are() -> None:
    assert shares_of(target("ogden_1")) == []
    normal: Settings = {"distribution": "normal", "mean": 2.0, "sd": 1.0}
    assert shares_of(target("ogden_2", {"alpha": normal})) == []
    two = target("ogden_2")
    drawn = two.prior.sample(np.random.default_rng(4), 500)
    spring = ["mu_1", "mu_2", "alpha_1", "alpha_2"]
    columns = [two.names.index(name) for name in spring]
    two = replace(two, prior=two.prior.inherit(spring, drawn[:, columns]))
    assert shares_of(two) == []
