"""What straight lines between the samples of an excitation miss, and when it is said."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.study_folders import make_folder, replace_in, write_lines

from deabayes.checks.prepared import missed_by_lines, warn_if_coarse
from deabayes.checks.study import check_study
from deabayes.experiment import Excitation
from deabayes.faults import Report
from deabayes.study import Study


def voltage(time, values):
    return Excitation("voltage", "V", np.asarray(time), np.asarray(values))


def warnings(excitation):
    report = Report()
    warn_if_coarse(excitation, report)
    return report.warnings


def sine(per_period, periods=10, noise=0.0):
    time = np.arange(periods * per_period + 1) / per_period
    clean = 2e3 - 2e3 * np.cos(2.0 * np.pi * time)
    return voltage(time, clean + noise * np.random.default_rng(1).standard_normal(time.size))


@pytest.mark.parametrize("per_period", [8, 12, 20])
def test_what_is_missed_is_what_lines_miss(per_period):
    coarse = sine(per_period)
    between = np.linspace(0.0, 10.0, 100_001)
    exact = 2e3 - 2e3 * np.cos(2.0 * np.pi * between)
    halfway = (np.arange(10 * per_period) + 0.5) / per_period
    missed = coarse.at(halfway) - np.interp(halfway, between, exact)
    expected = np.sqrt(np.mean(missed**2)) / 4e3
    assert missed_by_lines(coarse) == pytest.approx(expected, rel=0.3)


def test_a_sine_of_few_samples_is_said_and_of_many_not():
    assert "2.1 % of its range" in warnings(sine(8))[0]
    assert warnings(sine(20, noise=40.0)), "a hundredth of the range of noise hides nothing"
    assert warnings(sine(32)) == []
    assert warnings(sine(200, noise=40.0)) == []


@pytest.mark.parametrize(
    "shape",
    [
        lambda time, rng: 3e3 * (time > 3.0),
        lambda time, rng: 3e3 * np.abs(time % 2.0 - 1.0),
        lambda time, rng: 3e3 * rng.standard_normal(time.size),
        lambda time, rng: 3e3 * np.minimum(time, 1.0),
        lambda time, rng: np.full_like(time, 3e3),
    ],
    ids=["step", "triangles", "noise", "ramp", "held"],
)
def test_what_lines_follow_is_not_said(shape):
    time = np.linspace(0.0, 10.0, 401)
    assert warnings(voltage(time, shape(time, np.random.default_rng(2)))) == []


def test_without_time_nothing_is_said():
    curve = np.linspace(0.0, 1.0, 30)
    turning = Excitation("stretch", "1", curve, np.sin(12.0 * curve), in_time=False)
    assert warnings(turning) == []


def test_check_says_it(tmp_path):
    folder = make_folder(tmp_path)
    rows = ["time [s],displacement [mm],force [N]"]
    for k in range(121):
        pulled = 30.0 * (1.0 - np.cos(2.0 * np.pi * k / 12))
        rows.append(f"{0.1 * k:.4f},{pulled:.4f},{0.02 * pulled + 0.001 * (k % 3):.5f}")
    write_lines(folder / "records" / "pull.csv", rows)
    replace_in(folder / "experiments.csv", ",0.25", ",")
    study = Study("s", folder, ("kv_gm_1",), calibrate=("pull",), validate=())
    report = check_study(study)
    assert report.faults == []
    (said,) = (warning for warning in report.warnings if "straight lines" in warning)
    assert said.startswith(
        "study s, pull: straight lines between the samples of the displacement miss"
    )
