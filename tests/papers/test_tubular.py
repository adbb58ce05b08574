"""Tables II to IV of the tubular actuator's paper, its amplifier check and its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.shared.tubes import QUANTITIES

from deabayes.experiment import Excitation, Experiment, Quantity, Specimen
from deabayes.noise import REGISTRY as NOISE
from deabayes.papers.base import StudyContext
from deabayes.papers.tubular import amplifier_current, circuit, inertial_parameter
from deabayes.posteriors.fitted import Fitted
from deabayes.study import Study
from deabayes.systems import build
from deabayes.systems.curves import drive_of, frequency_of, phasor
from deabayes.systems.tubular.circuit import Circuit

R_S, R_L, C = 954.0, 1e9, 180e-9


SPECIMEN = Specimen(
    "tube",
    "tubular",
    {"kind": "simulated"},
    {
        **QUANTITIES,
        "active_mass": Quantity(0.0462, "kg", 1e-3),
        "sensor_mass": Quantity(0.01, "kg", 5e-4),
        "cross_section": Quantity(6e-4, "m^2", 1.5e-5),
        "series_resistance": Quantity(R_S, "ohm", 250.0),
        "leakage_resistance": Quantity(R_L, "ohm", 2e8),
        "capacitance": Quantity(C, "F", 2e-9),
    },
    {"current_limit": Quantity(0.12, "A")},
)


CHAIN = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}


OMEGA = 2.0 * np.pi * 10.0


TIME = np.arange(0.0, 0.5, 1e-3)


def made_up(name, protocol, values, response="current", time=TIME, read=None, **metadata):
    drive = Excitation("voltage", "V", time, values, metadata)
    read = np.zeros(time.size) if read is None else read
    return Experiment(
        name, protocol, "calibrate", "time", "s", time, response, "A", read, np.ones(time.size),
        drive, metadata,
    )  # fmt: skip


def electrical(amplitude=1250.0):
    """A steady sine, caught at any phase, and the current of a circuit without leakage."""
    volts = amplitude * (1.0 + np.sin(OMEGA * TIME + 0.4))
    admittance = 1j * OMEGA * C / (1.0 + 1j * OMEGA * R_S * C)
    current = amplitude * (admittance * np.exp(1j * (OMEGA * TIME + 0.4))).imag
    return made_up("electrical_10Hz", "sine", volts, read=current)


def sweep(name="frequency_response_100g", response="gain", **changes):
    frequency = np.arange(1.0, 100.25, 0.5)
    metadata = {"amplitude_kV": 0.5, "bias_kV": 2.0, "load_g": 100.0} | changes
    one = made_up(name, "frequency_response", frequency, response, frequency, **metadata)
    return replace(one, coordinate_name="frequency", coordinate_unit="Hz")


def fitted(candidate, count=2000, **changes):
    rng = np.random.default_rng(1)
    draws = {
        "series_resistance": R_S * np.exp(0.02 * rng.standard_normal(count)),
        "leakage_resistance": np.full(count, R_L),
        "capacitance": np.full(count, C),
        "moving_mass": np.full(count, 0.0472 + 0.5 * (0.1005 - 0.0472) + 0.01),
        "cross_section": np.full(count, 6e-4),
        **{name: np.full(count, value) for name, value in CHAIN.items()},
    } | changes  # fmt: skip
    system = build("tubular", candidate, SPECIMEN)
    noise = NOISE["white"]()
    return Fitted(candidate, SPECIMEN, system, noise, False, "record", draws, (), True)


def context(*candidates, experiments=None, specimen=SPECIMEN):
    study = Study("made_up", Path("data/tubular"), candidates)
    records = [electrical()] if experiments is None else experiments
    return StudyContext(study, specimen, records, {name: fitted(name) for name in candidates})


def test_a_sine_is_found_in_a_record():
    """Beside a mean and a drift, by its crossings and by least squares."""
    time = np.linspace(0.0, 0.37, 400)
    values = 3.0 * np.sin(2.0 * np.pi * 12.5 * time + 0.7) + 5.0 + 0.1 * time
    assert frequency_of(time, values) == pytest.approx(12.5, rel=2e-3)
    found = phasor(time, values, 12.5)
    assert (abs(found), np.angle(found)) == pytest.approx((3.0, 0.7), abs=1e-9)
    assert np.isnan(frequency_of(time, time))
    assert drive_of(electrical()) == pytest.approx((1250.0, 10.0), rel=1e-4)
    assert drive_of(sweep()) == (500.0, 100.0)
    assert drive_of(made_up("creep", "creep", np.ones(TIME.size))) is None


def test_table_3_has_the_posterior_and_the_phase_method_beside_it():
    tables = circuit.compute(context("circuit")).tables
    (row,) = tables["table_3_circuit"].to_dict("records")
    assert row["series_resistance_ohm"] == pytest.approx(R_S, rel=2e-3)
    wide = row["series_resistance_q95"] - row["series_resistance_q05"]
    assert wide == pytest.approx(2 * 1.645 * 0.02 * R_S, rel=0.06)
    assert (row["leakage_resistance_Gohm"], row["capacitance_nF"]) == pytest.approx((1.0, 180.0))
    assert row["series_time_constant_ms"] == pytest.approx(1e3 * R_S * C, rel=2e-3)
    assert row["electrical_time_constant_ms"] < row["series_time_constant_ms"]
    table = tables["table_3_phase_method"].set_index("source")
    assert table.loc["circuit", "phase_rad"] == pytest.approx(
        np.arctan(1.0 / (OMEGA * R_S * C)), abs=1e-4
    )
    measured = table.loc["(15), electrical_10Hz"]
    assert measured["series_time_constant_ms"] == pytest.approx(1e3 * R_S * C, rel=2e-3)
    printed = table.loc["(15), Sarban et al. 2012"]
    assert list(printed[["series_time_constant_ms", "from_ms", "to_ms"]]) == pytest.approx(
        [0.172, 0.092, 0.251], abs=6e-4
    )
    rounded = table.loc["(15), electrical_10Hz, rounded"]
    assert rounded["phase_rad"] == pytest.approx(1.56)
    assert rounded["to_ms"] == pytest.approx(printed["to_ms"], rel=1e-3)


def test_without_a_candidate_with_circuit_it_is_the_stated_one():
    tables = circuit.compute(context("voigt_kelvin_2")).tables
    (row,) = tables["table_3_circuit"].to_dict("records")
    assert row["candidate"] == "specimen.yaml"
    assert row["series_resistance_q95"] - row["series_resistance_q05"] == pytest.approx(
        800, rel=0.1
    )
    bare = replace(SPECIMEN, quantities=QUANTITIES)
    unknown = circuit.compute(context("voigt_kelvin_2", specimen=bare)).tables
    assert list(unknown) == ["table_3_phase_method"]


def test_a_circuit_that_only_predictions_use_counts():
    one = context("voigt_kelvin_2")
    wider = {"sine": build("tubular", "voigt_kelvin_2_inertia_circuit", SPECIMEN)}
    predicting = replace(fitted("voigt_kelvin_2"), predicts_with=wider)
    found = replace(one, candidates={"voigt_kelvin_2": predicting})
    (row,) = circuit.compute(found).tables["table_3_circuit"].to_dict("records")
    assert (row["candidate"], row["order"]) == ("voigt_kelvin_2 (prior, not fitted)", 2)


def test_amplifier_current_of_each_record():
    step = made_up("creep_2000V", "creep", np.full(TIME.size, 2000.0))
    phase = sweep("frequency_response_100g_phase", "phase")
    large = sweep("large", amplitude_kV=2.0)
    every = [electrical(), sweep(), phase, large, step, sweep("unsaid", amplitude_kV="half")]
    table = amplifier_current.compute(context("circuit", experiments=every)).tables
    own = replace(SPECIMEN, instruments={"current.current_limit": Quantity(0.12, "A")})
    stated = amplifier_current.compute(context("circuit", experiments=every, specimen=own)).tables
    assert stated["amplifier_current"].equals(table["amplifier_current"])
    rows = table["amplifier_current"].set_index("experiment")
    assert list(rows.index) == [
        "electrical_10Hz", "frequency_response_100g", "large", "creep_2000V",
    ]  # fmt: skip
    one = Circuit(np.array([R_S]), np.array([R_L]), np.array([C]))
    expected = one.current_amplitude(500.0, np.array([100.0]))[0, 0]
    assert rows.loc["frequency_response_100g", "current_mA"] == pytest.approx(
        1e3 * expected, rel=1e-4
    )
    assert rows.loc["large", "current_mA"] > 120.0
    assert list(rows["verdict"]) == [
        amplifier_current.UNDER, amplifier_current.UNDER, amplifier_current.OVER,
        "at the limit at first: no step on that scale",
    ]  # fmt: skip
    held = (2000.0 - R_S * 0.12) * C / 0.12
    assert rows.loc["creep_2000V", "at_limit_ms"] == pytest.approx(1e3 * held, rel=1e-3)


def test_a_verdict_that_the_draws_do_not_agree_on():
    draws = Circuit(np.full(4, R_S), np.full(4, R_L), np.array([0.3, 0.9, 1.1, 1.2]) * C)
    limit = Circuit(draws.series_resistance[:1], draws.leakage_resistance[:1], np.array([C]))
    exactly = limit.current_amplitude(500.0, np.array([100.0]))[0, 0]
    found = amplifier_current.sine_row(500.0, 100.0, draws, exactly)
    assert found["verdict"] == "over the limit in 50 % of the draws"
    gentle = amplifier_current.step_row(100.0, draws, 0.12)
    assert (gentle["at_limit_ms"], gentle["verdict"]) == (0.0, amplifier_current.UNDER)


def test_a_sine_beyond_the_amplifier_is_a_caution():
    system = build("tubular", "voigt_kelvin_2", SPECIMEN)
    assert system.cautions(electrical()) == ()
    assert system.cautions(sweep()) == ()
    (caution,) = system.cautions(sweep(amplitude_kV=2.0))
    assert "2000 V at 100 Hz takes 225 mA by (16), more than the amplifier's 120 mA" in caution
    own = replace(SPECIMEN, instruments={"current.current_limit": Quantity(0.12, "A")})
    stated = build("tubular", "voigt_kelvin_2", own)
    assert stated.cautions(sweep(amplitude_kV=2.0)) == (caution,)
    unlimited = replace(SPECIMEN, instruments={})
    wild = build("tubular", "voigt_kelvin_2", unlimited)
    assert wild.cautions(sweep(amplitude_kV=2.0)) == ()


def test_table_2_by_hand():
    """(46.2 + 27.15 + 10 + load) g x 0.07 m / 6e-4 m^2, and 1 g more of active mass halved."""
    found = context("voigt_kelvin_2", "voigt_kelvin_2_inertia", experiments=[sweep(load_g=50.0)])
    table = inertial_parameter.compute(found).tables["table_2_inertial_parameter"]
    rows = table.set_index(["candidate", "load_g"])
    assert len(rows) == 2 * 5  # of the paper's four loads and the record's
    for load in (0.0, 50.0, 100.0, 300.0, 500.0):
        row = rows.loc[("specimen.yaml", load)]
        expected = (46.2 + 27.15 + 10.0 + load) * 1e-3 * 0.07 / 6e-4
        assert row["inertial_parameter_kgm"] == pytest.approx(expected, rel=3e-3)
        assert row["moving_mass_g"] == pytest.approx(83.35 + load, abs=0.1)
        half = 0.5 * (row["moving_mass_q95"] - row["moving_mass_q05"])
        assert half == pytest.approx(1.645 * np.hypot(0.5, 0.5), rel=0.06)
    fixed = rows.loc[("voigt_kelvin_2_inertia", 0.0)]
    expected = (83.35 + 0.5) * 1e-3 * 0.07 / 6e-4
    assert fixed["inertial_parameter_kgm"] == pytest.approx(expected, rel=1e-12)
    bare = context("voigt_kelvin_2", specimen=replace(SPECIMEN, quantities={}))
    assert inertial_parameter.compute(bare).tables == {}
