"""What is read off the structure's cycles, from made-up posteriors: phase, creep, amplitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared import structure_contexts as made_up
from tests.shared.structure_contexts import MOVING, computed, exact, motion

from deabayes.papers import hysteresis
from deabayes.papers.base import beside
from deabayes.papers.minimum_energy_structure import error_against_phase, structure_amplitude
from deabayes.papers.timing import Cycles


def test_the_phase_is_counted_from_the_lowest_voltage():
    record = made_up.sine(5.0, 5.0)
    at = (np.arange(made_up.POINTS) + 0.5) / made_up.POINTS - 0.05
    np.testing.assert_allclose(
        error_against_phase.phase(record)[20:40], at % 1.0, atol=1e-3
    )  # fmt: skip
    points = error_against_phase.stable_points(record)
    assert set(points) == set(range(120, 140))
    lowest = record.excitation.at(record.coordinate[points])
    assert np.argmin(lowest) in (0, 19) and np.argmax(lowest) in (9, 10)


def test_a_negative_voltage_is_read_like_a_positive_one():
    """It makes the same motion; after the step `cycles` it ended in an IndexError."""
    record = made_up.sine(5.0, 5.0)
    turned = replace(record.excitation, values=-record.excitation.values)
    negative = replace(record, excitation=turned)
    np.testing.assert_array_equal(
        error_against_phase.phase(negative), error_against_phase.phase(record)
    )
    assert structure_amplitude.levels(negative) == structure_amplitude.levels(record)
    assert structure_amplitude.levels(negative)[0] == pytest.approx(500.0)


def test_a_voltage_whose_cycles_are_not_seen_has_no_phase():
    """A rest at zero before a small sine about a bias: only the step `cycles` knows them."""
    record = made_up.sine(5.0, 5.0)
    drive = record.excitation
    biased = np.where(drive.values > 0.0, 4e3 + 0.1 * drive.values, 0.0)
    small = replace(record, excitation=replace(drive, values=biased))
    assert Cycles.of(small).starts.size and error_against_phase.stable_points(small).size == 0
    assert structure_amplitude.levels(small)[1] == pytest.approx(4.5e3)


def test_errors_of_the_stable_cycle():
    found = error_against_phase.compute(exact(motion(), 0.02))
    assert len(found.curves) == 6
    table = found.tables["phase_errors"]
    columns = [f"{what}_{kV}kV_percent" for what in ("largest", "mean") for kV in (5, 4)]
    np.testing.assert_allclose(table[columns], 2.0)
    curve = found.curves["sine_4kV_10Hz"]
    assert np.all(np.diff(curve["phase"]) > 0.0)
    np.testing.assert_allclose(curve["error"], 2.0)
    back = curve["measured"] - 0.02 * made_up.sine(4.0, 10.0).response_range
    np.testing.assert_allclose(curve["predicted"].sel(bound="median")[0], back)


def test_creep_is_counted_between_the_cycles_that_are_there():
    tables = hysteresis.compute(exact(motion())).tables
    cycles = tables["hysteresis_cycles"]
    one = cycles[(cycles["candidate"] == MOVING[0]) & (cycles["experiment"] == "sine_5kV_1Hz")]
    assert list(one["cycle"]) == [1, 2, 3, 4, 5, 8, 13]
    mean, drift = 1e3 * one["measured_mean_mm"].to_numpy(), one["measured_drift_um"].to_numpy()
    assert drift[-1] == pytest.approx((mean[-1] - mean[-2]) / 5.0)
    np.testing.assert_allclose(one["predicted_drift_um"][1:], drift[1:], rtol=1e-9)
    stable = tables["hysteresis_stability"]
    assert set(stable["measured_stable_from"]) <= {1.0, 2.0, 3.0, 4.0, 5.0, 8.0}
    first = stable[stable["experiment"] == "sine_5kV_1Hz"].iloc[0]
    assert first["measured_creep_um"] == pytest.approx(mean[-1] - mean[0])


def test_the_predicted_curve_meets_the_records():
    found = computed("structure_amplitude", "motion")
    bands = found.curves["bands_5kV"]
    four = bands["predicted"].sel(candidate=MOVING[1], bound="median")
    table = found.tables["structure_amplitude"].set_index(["candidate", "frequency_Hz"])
    for hertz in (1.0, 10.0):
        at = float(four.sel(frequency=hertz, method="nearest")) / 1e-3
        assert at == pytest.approx(table.loc[(MOVING[1], hertz), "predicted_5kV_mm"], rel=0.01)
    assert bands.attrs["lowest_kV"] == pytest.approx(0.5, abs=0.01)
    assert float(bands["frequency"][-1]) > 40.0 and bands.attrs["last_sine_Hz"] < 10.1
    assert float(found.curves["bands_4kV"]["frequency"][-1]) < 10.1
    record = made_up.sine(4.0, 5.0)
    row = structure_amplitude.record_row(record, np.tile(1.1 * record.response, (3, 1)))
    assert row["error_percent"] == pytest.approx(10.0)
    assert row["measured_mm"] == pytest.approx(1e3 * np.ptp(record.response[-20:]), rel=0.01)


def test_rows_of_two_voltages_are_joined():
    head = {"candidate": "a", "order": 1, "converged": True, "frequency_Hz": 2.0}
    rows = [head | {"voltage_kV": v, "e_mm": v, "e_q05": -v, "role": "x"} for v in (4.0, 5.0)]
    (found,) = beside(rows)
    assert list(found)[4:] == ["e_5kV_mm", "e_5kV_q05", "role_5kV", "e_4kV_mm", "e_4kV_q05",
                               "role_4kV"]  # fmt: skip
    assert found["e_4kV_q05"] == -4.0


def test_a_voltage_recorded_twice_at_one_frequency_keeps_both_rows():
    head = {"candidate": "a", "order": 1, "converged": True, "frequency_Hz": 2.0}
    recorded = [(5.0, 1.0), (4.0, 2.0), (5.001, 3.0)]
    found = beside([head | {"voltage_kV": v, "e_mm": e} for v, e in recorded])
    assert found == [
        head | {"e_5kV_mm": 3.0, "e_4kV_mm": 2.0},
        head | {"e_5kV_mm": 1.0},
    ]


def test_two_sines_of_one_frequency_have_one_curve_between_them():
    context = motion()
    first = next(e for e in context.experiments if e.name == "sine_5kV_1Hz")
    twice = [first, replace(first, name="again")]
    bands = structure_amplitude.sine_curves(context, twice, [])
    assert bands["frequency"].size == 1 and bands["measured"].size == 2
