"""How fast a record is, and how a prediction leaves what the calibration records span."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.prediction.test_noise_origin import fitted as membrane_fitted
from tests.shared.contexts import experiment
from tests.shared.membranes import step, voltage
from tests.shared.structure_contexts import fitted as structure_fitted
from tests.shared.structure_contexts import force
from tests.shared.structures import pull
from tests.systems.test_tubular_frequency_response import SPECIMEN as TUBE
from tests.systems.test_tubular_frequency_response import experiments as gain_and_phase

from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.inference.record_noise import ResidualScale
from deabayes.prediction.calibrated import CalibratedRecord, fastest, records_to_json
from deabayes.systems.tensile_strip.system import TensileStrip
from deabayes.systems.tubular.system import Tubular


def driven(knots, values, read, coordinate_name="time"):
    read = np.asarray(read, dtype=float)
    return Experiment(
        name="record",
        protocol="step",
        role="calibrate",
        coordinate_name=coordinate_name,
        coordinate_unit="s",
        coordinate=read,
        response_name="displacement",
        response_unit="m",
        response=np.zeros(read.size),
        samples_averaged=np.ones(read.size),
        excitation=Excitation("stretch", "1", np.asarray(knots, float), np.asarray(values, float)),
    )


@pytest.mark.parametrize("frequency", [0.01, 1.0, 60.0])
@pytest.mark.parametrize("mean", [0.0, 1500.0])
def test_a_sine_has_its_own_frequency(frequency, mean):
    time = np.linspace(0.0, 5.0 / frequency, 1001)
    values = mean + 1000.0 * np.sin(2.0 * np.pi * frequency * time)
    assert fastest(driven(time, values, time)) == pytest.approx(frequency, rel=0.01)


def test_a_sweep_has_its_highest_frequency():
    time = np.linspace(0.0, 20.0, 20001)
    phase = 2.0 * np.pi * (time + 9.0 * time**2 / 40.0)
    found = fastest(driven(time, np.sin(phase), time))
    assert found == pytest.approx(10.0, rel=0.02)


def test_monitor_noise_does_not_count_as_a_change():
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 100.0, 50001)
    values = 2000.0 * np.sin(2.0 * np.pi * 0.05 * time) + rng.normal(0.0, 20.0, time.size)
    assert fastest(driven(time, values, time[::100])) == pytest.approx(0.05, rel=0.3)


def test_a_ramp_has_the_frequency_of_its_duration():
    read = np.linspace(0.0, 40.0, 4001)
    found = fastest(driven([0.0, 2.0, 40.0], [1.0, 3.0, 3.0], read))
    assert found == pytest.approx(np.arcsin(0.2) / (0.2 * np.pi * 2.0), rel=0.01)


def test_a_late_reading_after_a_ramp_limits_the_frequency():
    ramp = driven([0.0, 2.0, 9.0], [0.0, 1.0, 1.0], [0.0, 3.0, 4.0, 5.0])
    assert fastest(ramp) == pytest.approx(1.0 / (2.0 * np.pi * (1.0 + 0.44)), rel=0.01)


@pytest.mark.parametrize("masked", [0.006, 0.5, 150.0])
def test_after_a_step_the_first_reading_decides(masked):
    knots, values = [0.0, 1.0, 1.0 + 1e-6, 1000.0], [0.0, 0.0, 4e3, 4e3]
    read = np.concatenate([np.linspace(0.0, 1.0, 11), np.linspace(1.0 + masked, 999.0, 100)])
    found = fastest(driven(knots, values, read))
    assert found == pytest.approx(1.0 / (2.0 * np.pi * masked), rel=1e-3)


def test_without_readings_after_a_step_the_sine_decides():
    time = np.linspace(0.0, 1.0, 10001)
    values = np.where(time < 0.05, 0.0, 1000.0 + 1000.0 * np.sin(20.0 * np.pi * (time - 0.05)))
    whole = fastest(driven(time, values, time))
    cropped = fastest(driven(time, values, time[time > 0.2]))
    assert whole > 100.0
    assert cropped == pytest.approx(10.0, rel=0.1)


def test_a_voltage_is_zero_before_it_begins():
    """As every system takes it: a constant voltage is a step, a constant stretch is none."""
    stretched = driven([0.0, 1.0], [5.0, 5.0], [0.0, 0.001, 0.5])
    assert fastest(stretched) == 0.0
    voltage = replace(stretched.excitation, name="voltage", unit="V")
    assert fastest(replace(stretched, excitation=voltage)) == pytest.approx(
        1.0 / (2.0 * np.pi * 0.001), rel=1e-3
    )


def test_frequency_is_zero_without_a_change_or_a_reading_after_it():
    assert fastest(driven([0.0, 1.0], [0.0, 0.0], [0.5])) == 0.0
    assert fastest(driven([0.0, 1.0, 1.1, 2.0], [0.0, 0.0, 1.0, 1.0], [0.2, 0.4])) == 0.0


def test_no_frequency_without_time():
    assert np.isnan(fastest(driven([1.0, 2.0], [1.0, 2.0], [1.0, 2.0], "stretch")))


def test_frequency_does_not_depend_on_the_units_of_time_and_voltage():
    rng = np.random.default_rng(7)
    for _ in range(40):
        knots = np.cumsum(10.0 ** rng.uniform(-6.0, 2.0, 12))
        values, read = rng.normal(size=12), np.sort(rng.uniform(knots[0], knots[-1], 20))
        found = fastest(driven(knots, values, read))
        scaled = fastest(driven(1e-3 * knots, 1e3 * values + 7.0, 1e-3 * read))
        assert np.isfinite(found)
        assert scaled == pytest.approx(1e3 * found, rel=1e-3)


def remembered(*calibrated):
    """As a posterior file gives the records back."""
    kept = records_to_json([CalibratedRecord.of(e, "group", ResidualScale()) for e in calibrated])
    return tuple(CalibratedRecord(**each) for each in json.loads(kept))


def with_conditions(what, **conditions):
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
    assert found.extrapolation(with_conditions(force(5), voltage=20e3)) == (
        "voltage 20000 V lies outside the calibrated 0 to 5000 V"
    )
    assert found.extrapolation(with_conditions(force(5), voltage=-5e3)) == ""
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
    biased = with_conditions(light, **{**given, "bias_kV": 1.0})
    assert "bias_kV 1 lies outside the calibrated 2" in found.extrapolation(biased)
    wide = [with_conditions(light, **given, amplitude_kV=size) for size in (0.5, 2.0)]
    assert "amplitude_kV 2 " in tube(wide[0]).extrapolation(wide[1])


def test_a_record_without_a_load_counts_as_load_zero():
    drop = {k: v for k, v in gain_and_phase(100)[0].excitation.conditions.items() if k != "load_g"}
    bare = with_conditions(gain_and_phase(100)[0], **drop)
    assert tube(bare).extrapolation(with_conditions(bare, **drop, load_g=0.0)) == ""
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
        membrane_fitted(),
        system=TensileStrip("ogden_3", bare),
        records=remembered(with_conditions(pulled)),
    )
    assert (
        found.extrapolation(with_conditions(pulled, deformation="uniaxial", note="by hand")) == ""
    )
    assert found.extrapolation(with_conditions(pulled, deformation="equibiaxial")) == (
        "deformation equibiaxial was not calibrated (uniaxial was)"
    )


def test_what_a_response_does_not_depend_on_is_not_compared():
    calibrated = experiment("a", "step", step(4e3), np.linspace(1.0, 600.0, 50), "displacement")
    other = with_conditions(calibrated, voltage_kV=2.0, frequency_Hz=3.0, note="second day")
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


def test_old_files_lack_elapsed_times_and_conditions():
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
    assert plain.extrapolation(with_conditions(force(5), voltage=20e3)) == ""


def test_zero_voltage_is_calibrated_by_every_record():
    """A voltage is zero before its first knot, whether or not the file has it."""
    found = replace(membrane_fitted(), records=remembered(with_conditions(step_of(4e3))))
    assert found.extrapolation(step_of(2e3)) == found.extrapolation(late(0.0, 300.0)) == ""
    assert "4500 V lies outside the calibrated 0 to 4000" in found.extrapolation(step_of(4.5e3))


def step_of(volts):
    return experiment("step", "step", step(volts), np.linspace(1.0, 600.0, 50), "displacement")
