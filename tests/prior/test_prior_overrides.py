"""Priors that a config puts in the place of the default ones."""

from dataclasses import replace

import pytest
from tests.shared.priors import ALPHA, EVERYTHING, MU, TAU, parameter

from deabayes.faults import Faults, UserError
from deabayes.prior.distributions import LogNormal, LogUniform, Uniform
from deabayes.prior.joint import Prior


class TestOverrides:
    def test_by_name_with_units(self):
        settings = {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}
        prior = Prior.from_parameters((*MU, *ALPHA), {"mu_2": settings})
        assert prior.parameters[1].prior == LogNormal(35e3, 0.5)
        assert prior.parameters[1].source == "config"
        assert prior.parameters[0].prior == MU[0].prior

    def test_by_ordered_group_with_its_ratio(self):
        settings = {"distribution": "loguniform", "lower": "10 ms", "upper": 10, "minimum_ratio": 3}
        prior = Prior.from_parameters(TAU, {"tau": settings})
        assert {p.prior for p in prior.parameters} == {LogUniform(0.01, 10.0)}
        assert prior.minimum_ratios == {"tau": 3.0}
        assert (
            Prior.from_parameters(TAU, {"tau": {"minimum_ratio": 4}}).minimum_ratios["tau"] == 4.0
        )

    def test_a_ratio_that_the_law_cannot_keep_is_refused(self):
        settings = {"distribution": "uniform", "lower": 0.1, "upper": 100}
        with pytest.raises(UserError, match=r"priors\.tau: minimum_ratio 5 needs"):
            Prior.from_parameters(TAU, {"tau": {**settings, "minimum_ratio": 5}})
        flat = [replace(p, prior=Uniform(0.1, 100.0)) for p in TAU]
        with pytest.raises(UserError, match="or remove minimum_ratio"):
            Prior.from_parameters(flat, {"tau": {"minimum_ratio": 5}})
        prior = Prior.from_parameters(TAU, {"tau": {**settings, "minimum_ratio": 1}})
        assert prior.minimum_ratios == {"tau": 1.0}

    def test_noise_in_all_groups(self):
        noise = [parameter(f"{g}.sigma_ou", LogNormal(1.0, 1.0), "V") for g in ("creep", "sine")]
        settings = {"distribution": "halfnormal", "sd": "2 mV"}
        prior = Prior.from_parameters(noise, {"sigma_ou": settings})
        assert [p.prior.sd for p in prior.parameters] == [0.002, 0.002]

    def test_priors_of_other_candidates_are_ignored(self):
        settings = {"distribution": "lognormal", "median": 1, "sigma": 1}
        names = {"mu_9": settings, "J_alpha": settings}
        others = ["J_alpha", "mu_9"]
        assert Prior.from_parameters((*MU, *ALPHA), names, others).parameters == (*MU, *ALPHA)
        with pytest.raises(Faults, match=r"priors\.mu_9: no parameter has this name"):
            Prior.from_parameters((*MU, *ALPHA), names, ["J_alpha"])

    def test_all_mistakes_together(self):
        good = {"distribution": "lognormal", "median": 1, "sigma": 1}
        overrides = {
            "zeta_alfa": good,
            "tau_1": good,
            "mu_1": {"distribution": "lognormal", "median": "1 V", "sigma": 1},
            "offset": {**good, "minimum_ratio": 2},
            "thickness": None,
        }
        with pytest.raises(Faults) as caught:
            Prior.from_parameters(EVERYTHING, overrides)
        text = str(caught.value)
        assert len(caught.value.faults) == 5
        assert "did you mean 'zeta_alpha'" in text
        assert "set priors.tau" in text
        assert "priors.mu_1.median" in text
        assert "minimum_ratio is for ordered groups" in text
        assert "priors.thickness: expected a mapping" in text

    @pytest.mark.parametrize(
        ("settings", "found"),
        [
            ({"distribution": "uniform", "lower": "-50 Pa s", "upper": "-10 Pa s"}, "100 %"),
            ({"distribution": "uniform", "lower": -1, "upper": 10}, "9.09 %"),
            ({"distribution": "normal", "mean": 5, "sd": 5}, "15.9 %"),
        ],
    )
    def test_a_positive_parameter_has_no_prior_below_zero(self, settings, found):
        with pytest.raises(UserError, match=f"priors.zeta_alpha: .* must be positive.*{found}"):
            Prior.from_parameters(EVERYTHING, {"zeta_alpha": settings})

    def test_a_thin_tail_below_zero_is_no_mistake(self):
        settings = {"zeta_alpha": {"distribution": "normal", "mean": 5, "sd": 1}}
        assert Prior.from_parameters(EVERYTHING, settings).describe("zeta_alpha").startswith("norm")

    def test_a_half_product_prior_cannot_reach_below_zero(self):
        settings = {"mu_1": {"distribution": "normal", "mean": 0, "sd": 1}}
        with pytest.raises(UserError, match="it reaches below 0"):
            Prior.from_parameters((*MU, *ALPHA), settings)
