"""Frequency responses of the tubular actuator: model, reading, preparation, likelihood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.shared.golden import golden_table, load_golden
from tests.shared.tubes import QUANTITIES, STAND_INS

from deabayes.comparison.evidence import leave_one_experiment_out
from deabayes.experiment import Excitation, Experiment, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.inference.log_posterior import build
from deabayes.noise.base import CORRELATED_FRACTION
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import measured_rows, prepare
from deabayes.records.preparation.working import continuous_phase
from deabayes.study import Study
from deabayes.systems.tubular.system import Tubular
from deabayes.units import to_si

DELAY = 4e-4
CIRCUIT = {
    "series_resistance": Quantity(STAND_INS["series_resistance_ohm"], "ohm"),
    "leakage_resistance": Quantity(STAND_INS["leakage_resistance_ohm"], "ohm"),
    "capacitance": Quantity(STAND_INS["capacitance_F"], "F"),
}
SPECIMEN = Specimen(
    "tube", "tubular", {"kind": "simulated"}, QUANTITIES | CIRCUIT,
    {"delay": Quantity(DELAY, "s")},
)  # fmt: skip
WHOLE = "voigt_kelvin_2_inertia_circuit"


def draws(units=2):
    elements = STAND_INS["Kelvin_elements"][str(units)]
    found = {"E_0": STAND_INS["E0_Pa"]}
    found |= {f"E_{n}": e for n, e in enumerate(elements["E_Pa"], start=1)}
    found |= {f"tau_{n}": t for n, t in enumerate(elements["tau_s"], start=1)}
    return {name: np.array([value]) for name, value in found.items()}


def driven(frequency, **conditions):
    return Excitation("frequency", "Hz", frequency, frequency, {"bias_kV": 2.0} | conditions)


def response(candidate, what, frequency, draws=None, **conditions):
    excitation = driven(frequency, **conditions)
    return Tubular(candidate, SPECIMEN).predict(
        excitation, frequency, what, globals()["draws"]() if draws is None else draws
    )


@pytest.mark.parametrize("load", [100, 300, 500])
def test_golden(load):
    table = golden_table("tubular_frf", f"load_{load}g")
    gain, phase = (
        response(WHOLE, what, table["frequency"], load_g=load)[0] for what in ("gain", "phase")
    )
    np.testing.assert_allclose(100.0 * gain, table["gain"], rtol=1e-10)
    np.testing.assert_allclose(np.rad2deg(phase), table["phase"], rtol=1e-10)


def test_without_mass_and_circuit_it_is_the_complex_compliance():
    """Strain per volt is 2 k B D*(i omega), k the pressure per squared volt."""
    frequency = np.array([1.0, 10.0, 80.0])
    got, omega = draws(), 2j * np.pi * frequency
    compliance = 1.0 / got["E_0"] + sum(
        1.0 / (got[f"E_{n}"] * (1.0 + got[f"tau_{n}"] * omega)) for n in (1, 2)
    )
    per_square = 8.8541878188e-12 * 3.1 / 80e-6**2
    expected = 2.0 * per_square * 2000.0 * compliance
    gain = response("voigt_kelvin_2", "gain", frequency)[0]
    np.testing.assert_allclose(gain, np.abs(expected), rtol=1e-12)
    phase = response("voigt_kelvin_2", "phase", frequency)[0]
    np.testing.assert_allclose(phase, np.angle(expected), rtol=1e-12)


def test_more_mass_resonates_lower_and_a_draw_leaves_others_alone():
    frequency = np.arange(1.0, 100.0, 0.25)
    two = {name: np.repeat(values, 2) for name, values in draws().items()}
    two["E_0"] = np.array([1.5e6, -1.0])
    for load in (100, 500):
        both = response(WHOLE, "gain", frequency, two, load_g=load)
        alone = response(WHOLE, "gain", frequency, load_g=load)
        np.testing.assert_array_equal(both[0], alone[0])
        assert np.isnan(both[1]).all()
        resonance = load_golden("tubular_frf")["inputs"]["resonance"][f"{load} g"]
        top = resonance["frequency_of_peak_gain_Hz"]
        assert frequency[np.argmax(alone[0])] == pytest.approx(top, abs=0.13)


@pytest.mark.parametrize("conditions", [{"bias_kV": -1.0}, {"bias_kV": "two"}, {"bias_kV": None}])
def test_a_frequency_response_needs_its_bias(conditions):
    with pytest.raises(UserError, match="needs its bias voltage as bias_kV"):
        response(WHOLE, "gain", np.array([1.0, 2.0]), **conditions)


@pytest.mark.parametrize(("excitation", "what"), [("frequency", "strain"), ("voltage", "gain")])
def test_channels_that_do_not_go_together(excitation, what):
    given = Excitation(excitation, "", np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    with pytest.raises(UserError, match="a frequency response has excitation 'frequency'"):
        Tubular("voigt_kelvin_1", SPECIMEN).simulator(given, given.coordinate, what)


def record(load=300, columns=("gain", "phase")):
    """What an analyser writes: phase wrapped, the sensor's delay in it."""
    table = golden_table("tubular_frf", f"load_{load}g")
    wrapped = np.mod(np.deg2rad(table["phase_as_measured"]) + np.pi, 2.0 * np.pi) - np.pi
    every = {"frequency": table["frequency"], "phase": wrapped}
    every["gain"] = to_si(table["gain"], "%/V", "1/V")
    units = {"frequency": "Hz", "gain": "1/V", "phase": "rad"}
    kept = ("frequency", *columns)
    return RawRecord({n: every[n] for n in kept}, {n: units[n] for n in kept}, "ab" * 32)


def row(load=300, name="shaken"):
    return ExperimentRow(
        f"{name}_{load}g", "frequency_response", "a.csv", "calibrate", "frequency", "gain",
        {"load_g": float(load), "bias_kV": 2.0},
    )  # fmt: skip


def experiments(load=300, **changes):
    raw = record(load)
    return [
        replace(prepare(each, raw, SPECIMEN), **changes) for each in measured_rows(row(load), raw)
    ]


def test_a_gain_brings_its_phase():
    assert [each.name for each in measured_rows(row(), record())] == [
        "shaken_300g",
        "shaken_300g_phase",
    ]
    assert measured_rows(row(), record(columns=("gain",))) == [row()]
    gain, phase = experiments()
    assert gain.row == phase.row == "shaken_300g"
    assert (gain.response_unit, phase.response_unit) == ("1/V", "rad")


@pytest.mark.parametrize("load", [100, 300, 500])
def test_a_prepared_phase_is_continuous_and_without_the_delay(load):
    phase = experiments(load)[1]
    expected = np.deg2rad(golden_table("tubular_frf", f"load_{load}g")["phase"])
    np.testing.assert_allclose(phase.response, expected, atol=1e-10)
    assert [step["step"] for step in phase.steps] == ["delay"]


@pytest.mark.parametrize(("first", "expected"), [(0.1, 0.1), (3.0, 3.0 - 2 * np.pi), (-3.1, -3.1)])
def test_which_turn_a_phase_starts_in(first, expected):
    wrapped = np.mod(first - np.linspace(0.0, 8.0, 50) + np.pi, 2.0 * np.pi) - np.pi
    found = continuous_phase(wrapped)
    np.testing.assert_allclose(found, expected - np.linspace(0.0, 8.0, 50), atol=1e-12)


def target(noise="white", loads=(100, 500), **changes):
    study = Study("shaken", Path("data/tubular"), (WHOLE,), noise=noise, **changes)
    every = [each for load in loads for each in experiments(load)]
    return build(study, WHOLE, SPECIMEN, every)


def test_gain_and_phase_share_their_noise():
    found = target("ornstein_uhlenbeck")
    noise = [name for name in found.names if "." in name]
    assert noise == [f"frequency_response.{n}" for n in ("sigma_white", "sigma_ou", "tau_ou")]
    units = {p.name: p.unit for p in found.prior.parameters}
    assert units["frequency_response.sigma_ou"] == "1"
    assert units["frequency_response.tau_ou"] == "Hz"
    # As large as a ratio and an angle of one, not as the phase's range.
    medians = {p.name: p.prior.from_normal(np.array(0.0)) for p in found.prior.parameters}
    assert medians["frequency_response.sigma_ou"] == pytest.approx(CORRELATED_FRACTION)


@pytest.mark.parametrize("scale", ["absolute", "range"])
def test_the_likelihood_is_that_of_a_complex_ratio(scale):
    """White noise of sd s: independent normals in log gain and phase, s the same for both."""
    found = target(noise_scale=scale)
    theta = found.prior.to_parameters(
        np.random.default_rng(1).standard_normal((3, found.dimension))
    )
    named = found.draws(theta)
    sigma, expected = named["frequency_response.sigma_white"], np.zeros(3)
    for load in (100, 500):
        gain, phase = experiments(load)
        at = gain.coordinate
        model_gain, model_phase = (
            response(WHOLE, what, at, named, load_g=load) for what in ("gain", "phase")
        )
        for residual in (np.log(gain.response / model_gain), phase.response - model_phase):
            expected += np.sum(
                -0.5 * (residual / sigma[:, None]) ** 2
                - np.log(sigma)[:, None] - 0.5 * np.log(2.0 * np.pi), axis=1,
            )  # fmt: skip
        expected -= np.sum(np.log(gain.response))
    np.testing.assert_allclose(found.log_likelihood(theta), expected, rtol=1e-10)
    pointwise = sum(v.sum(axis=1) for v in found.pointwise_log_likelihood(theta).values())
    np.testing.assert_allclose(pointwise, expected, rtol=1e-10)


def test_a_gain_is_left_out_with_its_phase():
    found = target()
    z = np.random.default_rng(1).standard_normal((100, found.dimension))
    left_out = leave_one_experiment_out(found, 0.0, z, np.random.SeedSequence(1))
    assert list(left_out) == ["shaken_100g", "shaken_500g"]


def test_records_of_one_group_must_have_their_noise_in_one_unit():
    """A current and a strain of one sine, shared by protocol: amperes are no strain."""
    time = np.arange(0.0, 0.2, 1e-3)
    volts = Excitation("voltage", "V", time, 1250.0 + 1250.0 * np.sin(20.0 * np.pi * time))
    units = {"current": "A", "strain": "1"}
    sines = [
        Experiment(f"sine_{what}", "sine", "calibrate", "time", "s", time, what, unit,
                   np.linspace(0.0, 1.0, time.size), np.ones(time.size), volts)
        for what, unit in units.items()
    ]  # fmt: skip
    shared = Study("mixed", Path("data/tubular"), (WHOLE,))
    with pytest.raises(UserError, match="'sine' have different units: responses in 1 and A"):
        build(shared, WHOLE, SPECIMEN, sines)
    apart = build(replace(shared, noise_groups="experiment"), WHOLE, SPECIMEN, sines)
    assert {"sine_current.sigma_ou", "sine_strain.sigma_ou"} <= set(apart.names)
