"""From a posterior of the tubular actuator to Table IV and its figures; nothing is fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from tests.posteriors.test_predict_with import (
    STUDY,
    UNCERTAIN,
    creep,
    draws,
    file,
    prior_of_the_rest,
)
from tests.shared.golden import load_golden
from tests.systems.test_tubular_frequency_response import SPECIMEN, WHOLE, experiments

from deabayes import figures
from deabayes.experiment import Excitation, Experiment
from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.noise import REGISTRY as NOISE
from deabayes.papers.base import StudyContext
from deabayes.papers.tubular import resonance
from deabayes.pipeline import predict_candidate
from deabayes.posteriors.fitted import Fitted
from deabayes.posteriors.storage import write_tree
from deabayes.records.preparation.prepared import write_prepared
from deabayes.systems.tubular.system import Tubular

LOADS = (100, 300, 500)


def peaks(load):
    found = load_golden("tubular_frf")["inputs"]["resonance"][f"{load} g"]
    return found["frequency_of_peak_gain_Hz"], found["peak_gain_percent_per_V"]


@pytest.mark.parametrize("load", LOADS)
def test_a_measured_peak_lies_between_the_points(load):
    """On the paper's grid of 0.5 Hz, whose own greatest gain is 0.8 to 4.2 % low."""
    grid, (frequency, gain) = np.arange(1.0, 100.25, 0.5), peaks(load)
    excitation = Excitation("frequency", "Hz", grid, grid, {"bias_kV": 2.0, "load_g": load})
    response = Tubular(WHOLE, SPECIMEN).predict(excitation, grid, "gain", draws())[0]
    found = resonance.measured_peak(grid, response)
    assert found[0] == pytest.approx(frequency, rel=1e-4)
    assert 100.0 * found[1] == pytest.approx(gain, rel=1e-3)
    assert 100.0 * response.max() < 0.994 * gain


@pytest.mark.parametrize("gain", [np.linspace(1, 2, 9), np.linspace(2, 1, 9)])
def test_no_peak_where_the_gain_only_rises_or_falls(gain):
    assert np.isnan(resonance.measured_peak(np.arange(9.0), gain)).all()


def test_a_sharp_peak_takes_its_neighbours():
    """A damped mass on a spring, at few points: 1/gain^2 = (1 - x)^2 + 0.01 x, x = (f/3 Hz)^2."""
    square = (np.arange(1.0, 7.0) / 3.0) ** 2
    found = resonance.measured_peak(
        np.arange(1.0, 7.0), 1.0 / np.sqrt((1.0 - square) ** 2 + 0.01 * square)
    )
    assert found == pytest.approx((3.0 * np.sqrt(0.995), 1.0 / np.sqrt(0.005**2 + 0.00995)))


def context(candidate, count=40):
    values = {n: np.repeat(v, count) for n, v in draws().items()}
    values["E_0"] = values["E_0"] * np.linspace(0.98, 1.02, count)
    fitted = Fitted(candidate, SPECIMEN, Tubular(candidate, SPECIMEN), NOISE["white"](), False,
                    "record", values, (), True)  # fmt: skip
    records = [each for load in LOADS for each in experiments(load)]
    study = replace(STUDY, candidates=(candidate,))
    return StudyContext(study, SPECIMEN, records, {candidate: fitted})


def test_errors_of_the_peak():
    table = resonance.compute(context(WHOLE)).tables["table_4_resonance"]
    assert list(table["load_g"]) == [100.0, 300.0, 500.0]
    for row in table.itertuples():
        frequency, gain = peaks(int(row.load_g))
        assert row.predicted_frequency_Hz == pytest.approx(frequency, rel=1e-3)
        assert row.predicted_gain_percentperV == pytest.approx(gain, rel=1e-2)
        # E_0 alone sets most of the stiffness: its root is the frequency's.
        assert row.frequency_error_q05 == pytest.approx(row.frequency_error_percent - 0.8, abs=0.3)
        expected = 100.0 * (row.predicted_frequency_Hz / row.measured_frequency_Hz - 1.0)
        assert row.frequency_error_percent == pytest.approx(expected, abs=1e-6)
        expected = 100.0 * (row.predicted_gain_percentperV / row.measured_gain_percentperV - 1)
        assert row.gain_error_percent == pytest.approx(expected, abs=1e-6)


def test_without_mass_there_is_no_resonance():
    assert resonance.compute(context("voigt_kelvin_2")).tables == {}


def sine():
    time = np.arange(0.0, 1.0, 1e-3)
    volts = 1250.0 * np.sin(20.0 * np.pi * time) + 1250.0
    driven = Excitation("voltage", "V", time, volts)
    response = Tubular(WHOLE, UNCERTAIN).predict(driven, time, "strain", {
        **draws(), "series_resistance": np.array([954.0])})[0]  # fmt: skip
    return Experiment("sine_10Hz", "sine", "validate", "time", "s", time, "strain", "1", response,
                      np.ones(time.size), driven)  # fmt: skip


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> CandidateResults:
    study = tmp_path_factory.mktemp("results") / "shaken"
    folder = study / "voigt_kelvin_2"
    held_out = [replace(e, role="validate") for load in LOADS for e in experiments(load)]
    for each in (creep(), sine(), *held_out):
        write_prepared(
            replace(each, provenance="simulated"), study / "prepared" / f"{each.name}.nc"
        )
    folder.mkdir(parents=True)
    study_with_sines = replace(STUDY, predict_with={"frequency_response": "_inertia_circuit",
                                                    "sine": "_inertia_circuit"})  # fmt: skip
    write_tree(file(prior_of_the_rest(study_with_sines), study_with_sines),
               folder / "posterior.nc")  # fmt: skip
    predict_candidate(folder / "posterior.nc", study / "prepared", folder / "predictions",
                      folder / "errors.csv")  # fmt: skip
    return next(iter(StudyResults(study).candidates))


def words(figure) -> list[str]:
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]


def test_frequency_responses_are_drawn_together(results):
    (figure,) = figures.draw("frequency_response", results)
    gain, phase = figure.axes
    assert (gain.get_ylabel(), phase.get_ylabel()) == ("gain (%/V)", "phase (°)")
    assert (gain.get_yscale(), phase.get_yscale()) == ("log", "linear")
    assert phase.get_xlabel() == "frequency (Hz)"
    found = words(figure)
    assert {"100 g, held out", "300 g, held out", "500 g, held out"} <= set(found)
    assert "EXTRAPOLATION" in found and "simulated data" in found
    observed = 100.0 * experiments(100)[0].response
    assert any(np.array_equal(line.get_ydata(), observed) for line in gain.lines)


def test_a_sine_is_drawn_in_time_and_against_voltage(results):
    (figure,) = figures.draw("strain_voltage", results)
    first, last, loop = figure.axes
    assert first.get_ylabel() == "strain (%)"
    labels = ["time (ms), from rest", "time (ms), last cycles", "voltage (kV), last cycle"]
    assert [ax.get_xlabel() for ax in figure.axes] == labels
    assert last.lines[0].get_xdata().min() == pytest.approx(750.0, abs=2.0)
    cycle = loop.lines[0].get_xdata()
    assert cycle.size == pytest.approx(100, abs=2) and np.ptp(cycle) == pytest.approx(2.5, rel=0.01)
    assert "simulated data" in words(figure)


def test_a_current_is_no_strain(results):
    """The circuit's study has a sine too, of current."""
    current = results.predictions["sine_10Hz"].assign_attrs(response_name="current")
    electrical = replace(results)
    electrical.__dict__["predictions"] = {"electrical_10Hz": current}
    assert figures.module("strain_voltage").draw(electrical) == []


def test_what_was_predicted_with_mass_is_in_the_errors(results):
    table = pd.read_csv(Path(results.folder) / "errors.csv").set_index("experiment")
    assert "no calibration record" in table.loc["shaken_100g", "extrapolation"]
    assert {"shaken_100g_phase", "sine_10Hz"} <= set(table.index)
