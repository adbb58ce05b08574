"""Steps of preparation, on records whose right answer is known by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.strip_records import LAGGING, STRIP, curve, prepared, raw, relaxation, triangle

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import Faults, UserError
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import DEFAULT_STEPS, NEEDS_TIME, REGISTRY, prepare


def test_without_steps_a_record_is_only_relabelled() -> None:
    record = relaxation(end=20.0)
    experiment = prepared(record)
    assert np.array_equal(experiment.response, record.columns["force"])
    assert np.array_equal(experiment.excitation.values, record.columns["displacement"])
    assert np.all(experiment.samples_averaged == 1.0)
    assert experiment.coordinate_unit == "s"
    assert experiment.provenance == "simulated"


@pytest.mark.parametrize(
    ("step", "hidden"),
    [
        ({"mask_before": {"time": "500 ms"}}, [(0.0, 0.49)]),
        ({"mask_before": {"time": "0.5 s", "from_step": True}}, [(0.0, 1.49)]),
        ({"mask_after": {"time": 2.0}}, [(2.01, 20.0)]),
        ({"mask_between": {"from": "4 s", "to": "4.5 s"}}, [(4.0, 4.5)]),
        ({"mask_between": {"from": 4.0, "to": 4.5, "from_step": True}}, [(5.0, 5.5)]),
        ({"mask_between": {"from": 4.0, "to": 4.5, "record": "a"}}, [(4.0, 4.5)]),
        ({"mask_between": {"from": 4.0, "to": 4.5, "record": "b"}}, []),
        ({"crop": {"from": "1 s", "to": "3 s"}}, [(0.0, 0.99), (3.01, 20.0)]),
        ({"mask_ramp_end": {"before": "0.1 s", "after": "0.4 s"}}, [(2.91, 3.39)]),
        ({"mask_ramp_end": {"before": "0.1 s", "after": "0.4 s", "at": "5 s"}}, [(4.91, 5.39)]),
    ],
)
def test_masks_hide_what_they_say(
    step: dict[str, object], hidden: list[tuple[float, float]]
) -> None:
    record = relaxation(end=20.0)
    time, kept = record.columns["time"], prepared(record, step).coordinate
    gone = np.setdiff1d(time, kept)
    inside = np.zeros(gone.size, dtype=bool)
    for first, last in hidden:
        inside |= (gone >= first - 0.03) & (gone <= last + 0.03)
        assert not np.any((kept > first + 0.03) & (kept < last - 0.03))
    assert inside.all()


@pytest.mark.parametrize(("noise", "step"), [(1e-4, 1e-5), (4e-4, 0.0), (3e-4, 1e-3)])
def test_end_of_a_ramp_that_is_measured_with_noise(noise: float, step: float) -> None:
    """A noise of a four-hundredth and a hundredth of the way, and a coarse sensor."""
    record = relaxation(end=200.0)
    time, displacement, force = record.columns.values()
    read = displacement + noise * np.random.default_rng(1).normal(size=time.size)
    read = np.round(read / step) * step if step else read
    kept = prepared(raw(time, read, force), {"mask_ramp_end": {}}).coordinate
    gone = np.setdiff1d(time, kept)
    assert (gone.min(), gone.max()) == pytest.approx((2.9, 3.3), abs=0.05)


def test_masked_times_keep_their_excitation() -> None:
    record = relaxation(end=20.0)
    step = {"mask_ramp_end": {"before": "1 s", "after": "1 s"}}
    experiment = prepared(record, step, {"excitation_knots": {"tolerance": "0.01 mm"}})
    at = experiment.excitation.at(record.columns["time"])
    assert at.max() == pytest.approx(0.0408, abs=1e-5)
    assert np.abs(at - record.columns["displacement"]).max() <= 1e-5


def test_crop_forgets_the_future_but_not_the_past() -> None:
    experiment = prepared(relaxation(end=20.0), {"crop": {"from": "5 s", "to": "9.991 s"}})
    assert experiment.excitation.coordinate[0] == 0.0
    assert experiment.excitation.coordinate[-1] == pytest.approx(9.991)
    assert experiment.excitation.values[-1] == pytest.approx(0.04)


def test_slack_is_hidden_on_unloading_only() -> None:
    experiment = prepared(
        triangle(), {"mask_slack": {"threshold": "0.01 N"}}, protocol="load_unload"
    )
    assert experiment.coordinate[0] == 0.0  # the force is below the threshold there, too
    back = experiment.excitation.at(experiment.coordinate[experiment.coordinate > 10.0])
    assert back.min() == pytest.approx(0.021, abs=2e-4)


def test_slack_between_noisy_samples_is_hidden_whole() -> None:
    record = triangle()
    force = record.columns["force"].copy()
    force[1900] = 0.02  # one sample above the threshold within the slack
    noisy = raw(record.columns["time"], record.columns["displacement"], force)
    experiment = prepared(noisy, {"mask_slack": {"threshold": "0.01 N"}}, protocol="load_unload")
    assert experiment.coordinate.max() < 18.0


def test_baseline_is_the_mean_before_the_step() -> None:
    record = relaxation(end=20.0)
    shifted = raw(
        *(record.columns[k] for k in ("time", "displacement")), record.columns["force"] + 0.3
    )
    experiment = prepared(shifted, "baseline")
    assert np.allclose(experiment.response, record.columns["force"], atol=1e-12)


def test_baseline_needs_samples_before_the_step() -> None:
    with pytest.raises(UserError, match=r"where the excitation starts; give `until`"):
        prepared(triangle(), {"baseline": {}}, protocol="load_unload")


def test_the_delay_of_a_motions_sensor_is_not_the_currents() -> None:
    """A laser lags; the amplifier's monitor of its current does not."""
    time = np.arange(0.0, 2.0, 1e-3)
    columns = {"time": time, "voltage": 1e3 * np.minimum(time, 1.0), "current": 1e-3 * time}
    record = RawRecord(columns, {"time": "s", "voltage": "V", "current": "A"}, "ab" * 32)
    row = ExperimentRow("a", "step", "a.csv", "calibrate", "voltage", "current", {})
    laser = {"delay": Quantity(0.5, "s")}
    tube = Specimen("tube", "tubular", {"kind": "simulated"}, {}, laser)
    assert "delay" not in [step["step"] for step in prepare(row, record, tube).steps]
    with pytest.raises(UserError, match="`instruments: current: delay:` in specimen"):
        prepare(row, record, tube, [{"delay": {}}])
    own = replace(tube, instruments=laser | {"current.delay": Quantity(0.1, "s")})
    for steps in (None, [{"delay": {}}]):
        assert "0.1 s earlier" in str(prepare(row, record, own, steps).steps[0]["effect"])


@pytest.mark.parametrize(("step", "specimen"), [({"time": "0.5 s"}, STRIP), ({}, LAGGING)])
def test_delay_moves_the_response_not_the_excitation(step: object, specimen: Specimen) -> None:
    record = relaxation(end=20.0)
    experiment = prepared(record, {"delay": step}, specimen=specimen)
    late = np.interp(experiment.coordinate + 0.5, record.columns["time"], record.columns["force"])
    assert np.allclose(experiment.response, late, atol=1e-9)
    assert experiment.coordinate[0] >= 0.0  # nothing is known of what drove earlier values
    assert np.array_equal(experiment.excitation.coordinate, record.columns["time"])


def test_a_delay_is_undone_once() -> None:
    steps = {"delay": {}}, {"mask_before": {"time": "1 s"}}, {"delay": {"time": "1 s"}}
    with pytest.raises(UserError, match="preparation of a: step 'delay' is there twice"):
        prepared(relaxation(), *steps, specimen=LAGGING)
    assert prepared(relaxation(), *steps[:2], steps[1], specimen=LAGGING).coordinate.size


def test_known_delay_is_undone_by_default() -> None:
    row = ExperimentRow("a", "relaxation", "a.csv", "calibrate", "displacement", "force")
    assert prepare(row, relaxation(), LAGGING).steps[0]["step"] == "delay"
    assert prepare(row, relaxation(), STRIP).steps[0]["step"] != "delay"


def test_decimate_keeps_samples_as_measured() -> None:
    record = relaxation(end=20.0)
    experiment = prepared(record, {"mask_before": {"time": 1.0}}, {"decimate": {"every": 7}})
    visible = record.columns["force"][record.columns["time"] >= 1.0]
    assert np.array_equal(experiment.response, visible[::7])
    assert np.all(experiment.samples_averaged == 1.0)


def test_curve_without_time_is_put_in_order() -> None:
    stretch = np.array([1.0, 3.0, 2.0, 4.0, 5.0])
    experiment = curve(stretch, 10.0 * stretch, deformation="pure_shear", note="not a condition")
    assert np.array_equal(experiment.coordinate, np.sort(stretch))
    assert np.array_equal(experiment.response, 10.0 * np.sort(stretch))
    assert "back and forth" in experiment.warnings[0]
    assert experiment.excitation.conditions == {"deformation": "pure_shear"}
    assert experiment.coordinate_name == "stretch"


def test_steps_remember_settings_and_what_they_did() -> None:
    step = {"mask_before": {"time": "0.5 s"}}
    entry = prepared(relaxation(end=20.0), step).steps[0]
    assert entry["step"] == "mask_before"
    assert entry["settings"] == {"time": "0.5 s"}
    assert entry["effect"] == "masked 25 of 1000 samples"
    assert np.allclose(entry["masked"], [[0.0, 0.48]])


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"mask_befor": {}}, "unknown step 'mask_befor'; did you mean 'mask_before'"),
        ({"mask_before": {"tme": 1}}, "unknown setting 'tme'; did you mean 'time'"),
        ({"mask_before": {"time": "1 N"}}, "mask_before.time"),
        ({"mask_before": {}}, "needs 'time', a quantity in s"),
        ({"mask_before": {"time": 1e9}}, "leaves no sample"),
        ({"mask_before": {"time": 19.93}}, "leaves 3 points"),
        ({"mask_before": 3}, "settings must be"),
        ({"mask_before": {}, "crop": {}}, "each entry is one step"),
        ({"crop": {"from": 5, "to": 4}}, "must be smaller"),
        ({"average": {"grid": "geometri"}}, "did you mean 'geometric'"),
        ({"average": {"grid": "uniform", "ratio": 2}}, "unknown setting 'ratio'"),
        ({"average": {"ratio": 0.5}}, "must lie between 1 and 10, found 0.5"),
        ({"average": {"grid": "uniform", "points": 1.5}}, "expected a whole number"),
        ({"average": {"first_width": "-1 s"}}, "must be larger than 0"),
        (
            {"average": {"grid": "uniform", "width": "1 ns"}},
            "average: makes more than 100000 bins (19980000000); give a larger average.width",
        ),
        (
            {"average": {"first_width": "1 ns", "widest": "1 ns"}},
            "more than 100000 bins; give a larger average.first_width",
        ),
        ({"excitation_knots": {"tolerance": "1 s"}}, "excitation_knots.tolerance"),
        (
            {"excitation_knots": {"tolerance": "21 mm"}},
            "tolerance: 0.021 m is more than 0.0204 m, half of the displacement's range",
        ),
        (
            {"excitation_knots": {"tolerance": "1 mm", "fraction": 0.01}},
            "excitation_knots: 'tolerance' and 'fraction' cannot both be given; remove one",
        ),
        ({"average": {"grid": "uniform", "points": 20, "width": "1 s"}}, "'points' and 'width'"),
        ({"decimate": {"every": 7, "points": 20}}, "'every' and 'points' cannot both be given"),
        ({"delay": {}}, "give `time`, or `instruments: delay:`"),
        ({"delay": {"time": "-1 s"}}, "delay.time: must not be negative, found -1 s"),
        ({"mask_before": {"time": 1, "from_step": "yes"}}, "expected true or false"),
    ],
)
def test_mistakes_in_config_are_named(step: object, message: str) -> None:
    with pytest.raises(UserError) as error:
        prepared(relaxation(end=20.0), step)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", NEEDS_TIME)
def test_steps_in_time_refuse_a_curve(name: str) -> None:
    stretch = np.linspace(1.0, 2.0, 9)
    with pytest.raises(UserError, match="needs a record in time"):
        curve(stretch, stretch, name)


def test_faulty_record_is_refused() -> None:
    record = relaxation(end=20.0)
    force = record.columns["force"].copy()
    force[5] = np.nan
    with pytest.raises(Faults, match=r"a\.csv"):
        prepared(raw(record.columns["time"], record.columns["displacement"], force))


def test_defaults_exist_and_are_registered() -> None:
    for protocol, steps in DEFAULT_STEPS.items():
        for step in steps:
            assert set(step) <= set(REGISTRY), protocol
