"""In which respects a prediction leaves what was calibrated: held conditions, elapsed time."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from tests.prediction.test_noise_origin import fitted as membrane_fitted
from tests.shared.contexts import experiment
from tests.shared.membranes import step, voltage
from tests.shared.structure_contexts import fitted as structure_fitted
from tests.shared.structure_contexts import force
from tests.shared.structures import pull
from tests.systems.test_tubular_frequency_response import SPECIMEN as TUBE
from tests.systems.test_tubular_frequency_response import experiments as gain_and_phase

from deabayes.experiment import Specimen
from deabayes.inference.record_noise import ResidualScale
from deabayes.prediction.calibrated import CalibratedRecord, records_to_json
from deabayes.systems.tensile_strip.system import TensileStrip
from deabayes.systems.tubular.system import Tubular


def remembered(*calibrated):
    """As a posterior file gives the records back."""
    kept = records_to_json([CalibratedRecord.of(e, "group", ResidualScale()) for e in calibrated])
    return tuple(CalibratedRecord(**each) for each in json.loads(kept))


def held(what, **conditions):
    return replace(what, excitation=replace(what.excitation, conditions=conditions))


def structure(*kilovolts):
    found = structure_fitted("ogden_4", "quasi_static")
    return replace(found, records=remembered(*map(force, kilovolts)))


def tube(*calibrated):
    return replace(
        membrane_fitted(), specimen=TUBE, system=Tubular("voigt_kelvin_2", TUBE),
        records=remembered(*calibrated),
    )  # fmt: skip


def test_a_pull_under_a_voltage_never_calibrated():
    found = structure(0, 5)
    assert found.extrapolation(force(5)) == found.extrapolation(force(3)) == ""
    assert found.extrapolation(held(force(5), voltage=20e3)) == (
        "voltage 20000 V lies outside the calibrated 0 to 5000 V"
    )
    assert found.extrapolation(held(force(5), voltage=-5e3)) == ""
    assert "voltage 2000 V lies outside the calibrated 5000 V" in structure(5).extrapolation(
        force(2)
    )


def test_the_arrays_interface_compares_conditions_too():
    asked = structure(0, 5).experiment(
        {"displacement": np.linspace(0.0, 1e-2, 5)}, None, {"voltage": 20e3}
    )
    assert "voltage 20000 V" in structure(0, 5).extrapolation(asked)


def test_load_and_bias_of_a_frequency_response():
    light, heavy = gain_and_phase(100)[0], gain_and_phase(500)[0]
    found = tube(light, gain_and_phase(300)[0])
    given = light.excitation.conditions
    assert found.extrapolation(light) == ""
    assert found.extrapolation(heavy) == "load_g 500 lies outside the calibrated 100 to 300"
    biased = held(light, **{**given, "bias_kV": 1.0})
    assert "bias_kV 1 lies outside the calibrated 2" in found.extrapolation(biased)
    wide = [held(light, **given, amplitude_kV=size) for size in (0.5, 2.0)]
    assert "amplitude_kV 2 " in tube(wide[0]).extrapolation(wide[1])


def test_without_a_load_none_was_hung():
    drop = {k: v for k, v in gain_and_phase(100)[0].excitation.conditions.items() if k != "load_g"}
    bare = held(gain_and_phase(100)[0], **drop)
    assert tube(bare).extrapolation(held(bare, **drop, load_g=0.0)) == ""
    assert "load_g 100 lies outside the calibrated 0" in tube(bare).extrapolation(
        gain_and_phase(100)[0]
    )


def test_a_deformation_never_calibrated():
    stretch = np.linspace(1.0, 3.0, 20)
    pulled = replace(
        force(0), coordinate_name="stretch", coordinate=stretch, response_name="nominal_stress",
        response=stretch, excitation=replace(pull(stretch, 0.0), name="stretch", unit="1"),
    )  # fmt: skip
    bare = Specimen("bare", "tensile_strip", {}, {})
    found = replace(
        membrane_fitted(), system=TensileStrip("ogden_3", bare), records=remembered(held(pulled))
    )
    assert found.extrapolation(held(pulled, deformation="uniaxial", note="by hand")) == ""
    assert found.extrapolation(held(pulled, deformation="equibiaxial")) == (
        "deformation equibiaxial was not calibrated (uniaxial was)"
    )


def test_what_a_response_does_not_depend_on_is_not_compared():
    calibrated = experiment("a", "step", step(4e3), np.linspace(1.0, 600.0, 50), "displacement")
    other = held(calibrated, voltage_kV=2.0, frequency_Hz=3.0, note="second day")
    assert membrane_fitted([calibrated]).extrapolation(other) == ""


def late(first, last):
    """A step to 4 kV at 5 s, read between two times after it."""
    driven = voltage([0.0, 5.0, 5.01, 1000.0], [0.0, 0.0, 4e3, 4e3])
    time = 5.0 + np.linspace(first, last, 50)
    return experiment("late", "step", driven, time, "displacement")


def test_elapsed_time_counts_from_the_onset():
    found = replace(membrane_fitted(), records=remembered(late(0.0, 300.0)))
    assert found.extrapolation(late(0.0, 440.0)) == ""
    assert found.extrapolation(late(600.0, 900.0)) == (
        "900 s from the onset of the excitation is more than 1.5 times the longest calibration "
        "record (300 s)"
    )
    assert "600 s" in found.extrapolation(
        experiment("on", "step", step(4e3), np.linspace(590.0, 600.0, 50), "displacement")
    )
    masked = replace(membrane_fitted(), records=remembered(late(600.0, 900.0)))
    assert masked.extrapolation(late(500.0, 1300.0)) == ""


def test_files_from_before_are_judged_as_they_were():
    new = replace(membrane_fitted(), records=remembered(late(0.0, 300.0))).records[0]
    old = replace(new, elapsed=float("nan"), conditions=None)
    found = replace(membrane_fitted(), records=(old,))
    assert found.extrapolation(late(600.0, 900.0)) == ""
    assert found.extrapolation(late(0.0, 500.0)).startswith("500 s is more than 1.5 times")
    written = json.loads(records_to_json([new]))[0]
    del written["elapsed"], written["conditions"]
    again = CalibratedRecord(**written)
    assert np.isnan(again.elapsed) and again.conditions is None
    plain = structure(0, 5)
    plain = replace(plain, records=tuple(replace(r, conditions=None) for r in plain.records))
    assert plain.extrapolation(held(force(5), voltage=20e3)) == ""


def test_rest_belongs_to_every_record_that_a_voltage_drives():
    """A voltage is zero before its first knot, whether or not the file has it."""
    found = replace(membrane_fitted(), records=remembered(held(step_of(4e3))))
    assert found.extrapolation(step_of(2e3)) == found.extrapolation(late(0.0, 300.0)) == ""
    assert "4500 V lies outside the calibrated 0 to 4000" in found.extrapolation(step_of(4.5e3))


def step_of(volts):
    return experiment("step", "step", step(volts), np.linspace(1.0, 600.0, 50), "displacement")


def test_the_other_polarity_of_a_tube_is_no_extrapolation():
    time = np.linspace(0.0, 10.0, 50)
    driven = {sign: voltage([0.0, 10.0], [sign * 2e3, sign * 2e3]) for sign in (1.0, -1.0)}
    there, back = (
        replace(experiment("creep", "creep", step(2e3), time, "displacement"), excitation=each)
        for each in driven.values()
    )
    assert tube(there).extrapolation(back) == ""
