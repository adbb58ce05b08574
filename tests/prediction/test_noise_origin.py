"""Whose noise a predicted record is assumed to have, also if no record measured its response."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.shared.contexts import PAPER, experiment
from tests.shared.membranes import PLAIN, golden_draws, membrane, sine, step, voltage
from tests.shared.structure_contexts import fitted as structure_fitted
from tests.shared.structure_contexts import force

from deabayes.experiment import Excitation, Experiment, Quantity
from deabayes.faults import UserError
from deabayes.inference.record_noise import ResidualScale, noise_coordinate
from deabayes.noise import REGISTRY as NOISE
from deabayes.posteriors.fitted import Fitted
from deabayes.prediction.calibrated import CalibratedRecord, records_to_json
from deabayes.prediction.noise_origin import find_noise
from deabayes.systems.membrane.system import Membrane

TIME = np.linspace(1.0, 600.0, 300)
COUNT = 400
NOISE_DRAWS = {"step.sigma_white": 2e-6, "step.sigma_ou": 30e-6, "step.tau_ou": 20.0}


def record(volts, response="displacement"):
    return experiment(f"{response}_{volts}", "step", step(volts), TIME, response)


def fitted(calibrated=None, specimen=PLAIN, noise_scale="absolute"):
    calibrated = calibrated or [record(4e3)]
    draws = {n: np.full(COUNT, v[0]) for n, v in golden_draws(PAPER, 3).items()}
    draws |= {name: np.full(COUNT, value) for name, value in NOISE_DRAWS.items()}
    records = tuple(
        CalibratedRecord.of(
            each,
            "step",
            ResidualScale(each.response_range if noise_scale == "range" else 1.0),
            each.response_range if noise_scale == "mixed" else 1.0,
        )
        for each in calibrated
    )
    system = membrane("kv_gm_3", specimen=specimen)
    noise = NOISE["ornstein_uhlenbeck"]()
    return Fitted("kv_gm_3", specimen, system, noise, noise_scale, "record", draws, records, True)


def with_camera(noise=1.5e-6):
    return replace(PLAIN, instruments={"noise": Quantity(2e-6, "m"),
                                       "area.noise": Quantity(noise, "m^2")})  # fmt: skip


def spreads(found, what, seed=1):
    """Standard deviations of the correlated and of the white part of the prediction."""
    samples = found.sample(what, np.random.default_rng(seed))
    correlated = samples.discrepancy - samples.parameter
    white = samples.predictive - samples.discrepancy
    return correlated.std(), white.std()


def test_a_calibrated_record_has_its_own_noise():
    origin = fitted().noise_of(record(4e3))
    assert (origin.group, origin.scale, origin.note) == ("step", 1.0, "")


def test_noise_of_the_same_response_keeps_its_size():
    origin = fitted().noise_of(record(2e3))
    assert (origin.group, origin.scale, origin.note) == ("step", 1.0, "")
    correlated, white = spreads(fitted(), record(2e3))
    assert correlated == pytest.approx(30e-6, rel=0.1)
    assert white == pytest.approx(2e-6, rel=0.02)


def test_with_a_mixed_scale_only_correlated_noise_is_in_proportion_to_the_range():
    mixed = fitted(noise_scale="mixed")
    for asked in (record(4e3), record(3e3)):  # calibrated, and not
        correlated, white = spreads(mixed, asked)
        smallest = record(4e3).response_range
        assert correlated == pytest.approx(30e-6 * max(asked.response_range, smallest), rel=0.1)
        assert white == pytest.approx(2e-6, rel=0.02)
    wider = fitted([record(4e3), record(2e3)], noise_scale="mixed")
    correlated, white = spreads(wider, record(3e3))
    assert correlated == pytest.approx(30e-6 * record(3e3).response_range, rel=0.1)


@pytest.mark.parametrize("noise_scale", ["absolute", "range", "mixed"])
@pytest.mark.parametrize("camera", [False, True])
def test_noise_of_another_response_is_in_proportion_to_the_range(noise_scale, camera):
    """White noise is that of the sensor if the specimen states it."""
    area, calibrated = record(2e3, "area"), record(4e3)
    found = fitted(noise_scale=noise_scale, specimen=with_camera() if camera else PLAIN)
    correlated, white = spreads(found, area)
    shares = [area.response_range, area.response_range / calibrated.response_range]
    of_correlated = shares[noise_scale == "absolute"]
    of_white = shares[noise_scale != "range"]
    assert correlated == pytest.approx(30e-6 * of_correlated, rel=0.1)
    assert white == pytest.approx(1.5e-6 if camera else 2e-6 * of_white, rel=0.02)
    note = found.noise_of(area).note
    assert "no calibrated record measured area" in note and ("specimen.yaml" in note) == camera


def test_the_density_is_that_of_the_same_noise():
    """At the truth, the residual is zero: the log-density is that of the peak."""
    area = record(2e3, "area")
    density = fitted(specimen=with_camera()).sample(area, np.random.default_rng(1)).log_density
    wider = fitted(specimen=with_camera(15e-6)).sample(area, np.random.default_rng(1)).log_density
    assert np.all(density > wider)
    assert np.mean(density - wider) < TIME.size * np.log(10.0)


def test_a_record_of_the_same_unit_comes_before_one_of_the_same_protocol():
    driven = experiment("sine", "sine", sine(0.05), np.arange(1.0, 90.0), "displacement")
    records = [
        CalibratedRecord.of(record(4e3, "area"), "areas", ResidualScale()),
        CalibratedRecord.of(driven, "sines", ResidualScale()),
    ]
    found = replace(fitted(), records=tuple(records))
    assert found.noise_of(record(2e3)).group == "sines"
    assert found.noise_of(record(2e3, "area")).group == "areas"


def test_an_old_file_without_ranges_asks_to_fit_again():
    old = json.loads(records_to_json(list(fitted().records)))
    for each in old:
        del each["response_range"]
    found = replace(fitted(), records=tuple(CalibratedRecord(**each) for each in old))
    assert found.noise_of(record(2e3)).group == "step"
    with pytest.raises(UserError, match="fit again"):
        found.noise_of(record(2e3, "area"))


def test_ranges_survive_the_file():
    kept = json.loads(records_to_json(list(fitted().records)))
    assert [CalibratedRecord(**each) for each in kept] == list(fitted().records)
    assert asdict(fitted().records[0])["response_range"] == record(4e3).response_range


def test_the_sign_of_the_voltage_is_no_extrapolation():
    risen = voltage([0.0, 0.1, 600.0], [-0.4, 4e3, 4e3])
    found = fitted([experiment("risen", "step", risen, TIME, "displacement")])
    driven = experiment("sine", "sine", sine(0.05), np.arange(1.0, 90.0), "displacement")
    assert found.extrapolation(driven) == ""
    assert fitted([driven]).extrapolation(record(1e3)).startswith("600 s from the onset")
    higher = replace(driven, excitation=sine(0.05, amplitude=4500.0))
    assert "4500 V lies outside the calibrated 0 to 4000" in found.extrapolation(higher)
    assert "-2000" in replace(found, system=Odd("kv_gm_3", PLAIN)).extrapolation(driven)


def test_faster_changes_than_calibrated_are_flagged():
    slow = experiment("slow", "sine", sine(0.05), np.arange(1.0, 90.0), "displacement")
    quick = experiment("quick", "sine", sine(0.2), np.arange(1.0, 90.0, 0.5), "displacement")
    note = fitted([slow]).extrapolation(quick)
    assert note == ("the prediction reaches 0.2 Hz, and the calibration records only 0.05 Hz")
    sudden = replace(quick, excitation=step(2e3), coordinate=np.array([1e-4, 1.0, 50.0]))
    assert "reaches 1600 Hz, " in fitted([slow]).extrapolation(sudden)
    assert fitted([slow, quick]).extrapolation(quick) == ""
    assert fitted([quick]).extrapolation(slow) == ""
    old = replace(fitted([slow]).records[0], fastest=float("nan"))
    assert replace(fitted([slow]), records=(old,)).extrapolation(quick) == ""


class Odd(Membrane):
    """A system for which the sign counts."""

    even = ()


def test_noise_is_along_the_time_since_the_first_point():
    """A clock time that is stretched to another record's length loses its short steps."""
    elapsed = 2.0**-20 * np.arange(TIME.size)
    clock = replace(record(4e3), coordinate=1.7e9 + elapsed)
    np.testing.assert_array_equal(noise_coordinate("record", clock), elapsed)
    np.testing.assert_array_equal(noise_coordinate("grid", clock), np.arange(TIME.size))


def test_a_record_of_the_same_coordinate_comes_before_others_of_its_protocol():
    """Else its noise's length would be stretched from metres to volts."""
    pulled = replace(force(5), name="pulled")
    raised = replace(pulled, name="raised", coordinate_name="voltage", coordinate_unit="V")
    for calibrated in ([pulled, raised], [raised, pulled]):
        kept = tuple(CalibratedRecord.of(e, e.name, ResidualScale()) for e in calibrated)
        found = replace(structure_fitted("ogden_4", "quasi_static"), records=kept)
        for each in calibrated:
            origin = found.noise_of(replace(each, name="other"))
            assert (origin.group, origin.stretch) == (each.name, 1.0)


def test_a_new_excitation_predicts_the_usual_response_to_it():
    """Sines were calibrated, of displacement, which no pull answers with."""
    moved = CalibratedRecord.of(replace(force(5), excitation=sine(1.0)), "sine", ResidualScale())
    kept = replace(moved, response_name="displacement")
    found = replace(structure_fitted("ogden_4", "quasi_static"), records=(kept,))
    asked = found.experiment({"displacement": np.linspace(0.0, 1e-2, 5)}, None, {"voltage": 5e3})
    assert (kept.excitation_name, asked.response_name) == ("voltage", "force")


RATIOS = SimpleNamespace(
    proportional=("gain",),
    responses={"strain": "1", "gain": "1/V", "phase": "rad", "current": "A"},
    candidate="voigt_kelvin_2",
    specimen=SimpleNamespace(instruments={}),
)
GAIN = CalibratedRecord(
    "shaken", "frequency_response", "gains", 1.0, "gain", "frequency", 190.0, "frequency",
    10.0, 200.0, 8e-7, proportional=True,
)  # fmt: skip
PHASE = replace(
    GAIN, name="shaken_phase", response_name="phase", response_range=2.9, proportional=False
)
CREEP = replace(
    GAIN, name="creep", protocol="creep", group="creep", response_name="strain",
    response_range=0.04, proportional=False,
)  # fmt: skip
SHOWN_RANGE = 0.02


def strain() -> Experiment:
    time = np.linspace(0.0, 1.0, 50)
    drive = Excitation("voltage", "V", time, np.full(50, 2000.0))
    return Experiment(
        "pulled", "creep", "validate", "time", "s", time, "strain", "1", np.full(50, np.nan),
        np.ones(50), drive,
    )  # fmt: skip


@pytest.mark.parametrize("noise_scale", ["absolute", "range", "mixed"])
@pytest.mark.parametrize("records", [[GAIN], [PHASE], [GAIN, PHASE]])
def test_noise_of_a_gain_is_a_fraction_of_the_range_of_a_strain(records, noise_scale):
    """Whatever unit the gain is in: its residuals are logarithms, those of a phase radians."""
    origin = find_noise(strain(), records, RATIOS, noise_scale, "record")
    mean = np.linspace(0.0, SHOWN_RANGE, 50)[None]
    assert origin.scales(mean) == pytest.approx([SHOWN_RANGE])


def test_noise_of_a_strain_is_scaled_by_its_range():
    current = replace(strain(), response_name="current", response_unit="A")
    origin = find_noise(current, [CREEP], RATIOS, "absolute", "record")
    mean = np.linspace(0.0, SHOWN_RANGE, 50)[None]
    assert origin.scales(mean) == pytest.approx([SHOWN_RANGE / 0.04])
