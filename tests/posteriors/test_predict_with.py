"""Held-out records predicted with a wider candidate than the fitted one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.systems.test_tubular_frequency_response import SPECIMEN, draws, driven, experiments

from deabayes.api import Posterior
from deabayes.checks.study import check_names
from deabayes.experiment import Excitation, Experiment, Quantity
from deabayes.faults import UserError
from deabayes.inference.default_priors import further_prior
from deabayes.inference.log_posterior import build
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.file import posterior_tree
from deabayes.posteriors.fitted import Fitted
from deabayes.prior.joint import PriorFromPosterior
from deabayes.study import Study
from deabayes.systems.tubular.system import Tubular

UNCERTAIN = replace(
    SPECIMEN,
    quantities={
        **SPECIMEN.quantities,
        "active_mass": replace(SPECIMEN.quantities["active_mass"], sd=1e-3),
        "series_resistance": Quantity(954.0, "ohm", 200.0),
    },
)
ENDING = "_inertia_circuit"
STUDY = Study(
    "creep", Path("data/tubular"), ("voigt_kelvin_2",), noise="white",
    predict_with={"frequency_response": ENDING},
)  # fmt: skip
TIME = np.geomspace(1e-3, 0.5, 40)


def creep():
    step = Excitation("voltage", "V", np.array([0.0, 0.5]), np.array([2e3, 2e3]))
    strain = Tubular("voigt_kelvin_2", UNCERTAIN).predict(step, TIME, "strain", draws())[0]
    return Experiment(
        "creep", "creep", "calibrate", "time", "s", TIME, "strain", "1", strain,
        np.ones(TIME.size), step,
    )  # fmt: skip


def target():
    return build(STUDY, "voigt_kelvin_2", UNCERTAIN, [creep()])


def file(further, study=STUDY, fitted=None):
    fitted = fitted or target()
    z = np.random.default_rng(1).standard_normal((2, 300, fitted.dimension))
    names = [*fitted.names, *fitted.system.derived(draws())]
    table = pd.DataFrame(index=names, columns=["ess_bulk"], data=1.0).reindex(
        columns="mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat".split()
    )
    return posterior_tree(
        PosteriorContent(
            study, "voigt_kelvin_2", UNCERTAIN, fitted, z, np.zeros(z.shape[:2]), table,
            {"converged": True, "reasons": []}, [], np.random.SeedSequence(3), further,
        )
    )  # fmt: skip


def prior_of_the_rest(study=STUDY, inherited=None):
    fitted = target()
    return further_prior(study, fitted.system, fitted.names, inherited)


def test_parameters_left_out_of_the_fit_are_drawn_from_their_prior():
    further = prior_of_the_rest()
    assert further.names == ("moving_mass", "series_resistance")
    group = file(further)["posterior"]
    assert group["moving_mass"].attrs["kind"] == "prior"
    assert "not fitted" in group["moving_mass"].attrs["description"]
    values = group["series_resistance"].values
    assert values.shape == (2, 300)
    assert values.mean() == pytest.approx(954.0, abs=4 * 200 / np.sqrt(600))
    assert values.std() == pytest.approx(200.0, rel=0.12)


def test_priors_of_fitted_groups_and_of_noise_are_no_prior_of_the_rest():
    times = {"distribution": "loguniform", "lower": "1 ms", "upper": "1 s"}
    noise = {"distribution": "lognormal", "median": 1e-4, "sigma": 1.0}
    resistance = {"distribution": "lognormal", "median": "1 kohm", "sigma": 0.1}
    priors = {"tau": times, "sigma_white": noise, "series_resistance": resistance}
    further = prior_of_the_rest(replace(STUDY, priors=priors))
    assert [p.name for p in further.parameters if p.source == "config"] == ["series_resistance"]


def test_parameters_left_out_of_the_fit_are_drawn_from_another_posterior():
    rng = np.random.default_rng(1)
    mass = 83.4e-3 + 1e-4 * rng.standard_normal(2000)
    resistance = 900.0 + 3e5 * (mass - 83.4e-3) + 5.0 * rng.standard_normal(2000)
    inherited = PriorFromPosterior(
        ("moving_mass", "series_resistance"), np.column_stack([mass, resistance])
    )
    further = prior_of_the_rest(inherited=inherited)
    drawn = further.sample(np.random.default_rng(2), 4000)
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(
        np.corrcoef(mass, resistance)[0, 1], abs=0.02
    )
    # The fit itself knows none of these parameters, and is left as it is.
    alone = build(STUDY, "voigt_kelvin_2", UNCERTAIN, [creep()], inherited)
    assert alone.prior.inherited == ()


@pytest.mark.parametrize("study", [STUDY, replace(STUDY, predict_with={})])
def test_a_posterior_that_shares_nothing_is_refused(study):
    """Neither the fit nor its predictions know a membrane's modulus."""
    foreign = PriorFromPosterior(("mu_alpha",), np.full((50, 1), 35e3))
    with pytest.raises(UserError):
        build(study, "voigt_kelvin_2", UNCERTAIN, [creep()], foreign)


def test_without_predict_with_the_circuit_is_no_prior_of_the_fit():
    circuit = PriorFromPosterior(("series_resistance",), np.full((50, 1), 954.0))
    with pytest.raises(UserError):
        build(replace(STUDY, predict_with={}), "voigt_kelvin_2", UNCERTAIN, [creep()], circuit)


def test_a_study_that_predicts_with_nothing_else_has_nothing_further():
    plain = replace(STUDY, predict_with={})
    assert prior_of_the_rest(plain) is None
    assert "moving_mass" not in file(None)["posterior"]


def test_a_held_out_record_is_predicted_with_the_wider_candidate():
    fitted = Fitted.from_tree(file(prior_of_the_rest()), 50, 1)
    gain = replace(experiments(300)[0], role="validate")
    assert fitted.system_for(gain).candidate == "voigt_kelvin_2" + ENDING
    assert fitted.system_for(creep()).candidate == "voigt_kelvin_2"
    expected = Tubular("voigt_kelvin_2" + ENDING, UNCERTAIN).predict(
        gain.excitation, gain.coordinate, "gain", fitted.draws
    )
    np.testing.assert_array_equal(fitted.responses(gain), expected)
    # Its noise is that of creep, as a fraction of its range, and as long beside the record.
    origin = fitted.noise_of(gain)
    assert origin.proportional and "no calibrated record measured gain" in origin.note
    assert origin.scale == pytest.approx(1.0 / creep().response_range)
    assert origin.stretch == pytest.approx(np.ptp(TIME) / np.ptp(gain.coordinate))
    samples = fitted.sample(gain, np.random.default_rng(1))
    sigma = fitted.draws["creep.sigma_white"][:, None] * origin.scale
    scores = np.log(samples.predictive / samples.parameter) / sigma
    assert scores.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * scores.size))
    assert "no calibration record was driven by frequency" in fitted.extrapolation(gain)


def test_noise_of_a_calibrated_gain_is_that_of_another_in_proportion():
    study = Study("shaken", Path("data/tubular"), ("voigt_kelvin_2" + ENDING,), noise="white")
    fitted = build(study, "voigt_kelvin_2" + ENDING, SPECIMEN, experiments(100))
    from deabayes.prediction.calibrated import CalibratedRecord
    from deabayes.prediction.noise_origin import find_noise

    records = [CalibratedRecord.of(r.experiment, r.group, r.scale) for r in fitted.records]
    assert {r.response_name: r.proportional for r in records} == {"gain": True, "phase": False}
    for noise_scale in ("absolute", "range", "mixed"):
        gain, phase = (
            find_noise(e, records, fitted.system, noise_scale, "record") for e in experiments(500)
        )
        assert (gain.scale, gain.proportional, gain.stretch) == (1.0, True, 1.0)
        assert (phase.scale, phase.proportional) == (1.0, False)
        assert gain.note == phase.note == ""


def test_an_ending_that_no_candidate_has_is_refused():
    wrong = replace(STUDY, predict_with={"sine": "_inertai"})
    faults = check_names(wrong)
    assert any("predict_with" in f and "voigt_kelvin_2_inertai" in f for f in faults)


def test_driven_by_frequency_is_even_a_simulation():
    import deabayes

    found = deabayes.simulate(
        "tubular", "voigt_kelvin_2", {n: v[0] for n, v in draws().items()},
        {n: q.value for n, q in SPECIMEN.quantities.items()}, response="gain",
        conditions={"bias_kV": 2.0}, frequency=np.array([1.0, 2.0]),
    )  # fmt: skip
    expected = Tubular("voigt_kelvin_2", SPECIMEN).predict(
        driven(np.array([1.0, 2.0])), np.array([1.0, 2.0]), "gain", draws()
    )
    np.testing.assert_allclose(found["gain"].values, expected[0], rtol=1e-12)
    assert found["gain"].attrs["units"] == "1/V"


ASKED = {"response": "gain", "size": 20, "conditions": {"bias_kV": 2.0, "load_g": 300.0}}
FREQUENCY = np.array([20.0, 60.0, 90.0])


def test_the_interface_predicts_a_protocol_with_the_wider_candidate():
    post = Posterior(file(prior_of_the_rest()))
    wide = post.predict(frequency=FREQUENCY, protocol="frequency_response", **ASKED)
    fitted = Fitted.from_tree(post.data, 20, 1)
    expected = Tubular("voigt_kelvin_2" + ENDING, UNCERTAIN).predict(
        driven(FREQUENCY, load_g=300.0), FREQUENCY, "gain", fitted.draws
    )
    np.testing.assert_allclose(wide["mean"], expected.mean(axis=0), rtol=1e-12)
    assert wide.attrs["protocol"] == "frequency_response"
    assert wide.attrs["model_note"] == f"solved by voigt_kelvin_2{ENDING} (predict_with)"


def test_without_a_protocol_it_says_that_there_is_a_wider_one():
    post = Posterior(file(prior_of_the_rest()))
    plain = post.predict(frequency=FREQUENCY, **ASKED)
    assert plain.attrs["model_note"] == (
        "solved by voigt_kelvin_2, the fitted candidate; records of frequency_response are "
        f"predicted with voigt_kelvin_2{ENDING}: give the protocol"
    )
    other = post.predict(protocol="sine", frequency=FREQUENCY, **ASKED)
    assert other.attrs["model_note"] == ""
    alone = Posterior(file(None, replace(STUDY, predict_with={})))
    assert alone.predict(frequency=FREQUENCY, **ASKED).attrs["model_note"] == ""


def test_an_unknown_protocol_is_refused():
    post = Posterior(file(prior_of_the_rest()))
    with pytest.raises(UserError, match="did you mean 'frequency_response'"):
        post.predict(frequency=FREQUENCY, protocol="frequency_respons", **ASKED)


def test_what_is_predicted_is_checked_as_what_is_simulated():
    fitted = Fitted.from_tree(file(None), 50, 1)
    drive = {"time": TIME, "voltage": np.full(TIME.size, 2000.0)}
    for changes, conditions, words in (
        ({}, {"laod_g": 300.0}, "did you mean 'load_g'"),
        ({"voltage": np.full(TIME.size, np.nan)}, {}, "voltage must be finite, found nan at index"),
        ({"time": np.datetime64("2024-05-13") + np.arange(TIME.size)}, {}, "found dates"),
        ({"time": TIME[::-1]}, {}, "time must ascend"),
    ):
        with pytest.raises(UserError, match=words):
            fitted.experiment(drive | changes, None, conditions)
    assert fitted.experiment(drive, None, {"load_g": 300.0}).coordinate_name == "time"
