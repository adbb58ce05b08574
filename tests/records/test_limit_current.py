"""`limit_current`: the output of an amplifier that cannot supply what its command asks for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deabayes.experiment import Experiment, FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.integrate.amplifier import Amplifier
from deabayes.records.checks import checked
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare

TUBE = Amplifier(0.12, 954.0, 1e9, 180e-9)
LEAKY = Amplifier(0.05, 5e3, 1e5, 180e-9)
RINGING = 1000.0 + 1000.0 * np.sin(2.0 * np.pi * 300.0 * np.linspace(0.0, 0.02, 801))
COMMANDS = {
    "up and down": (np.array([0.0, 1e-4, 0.01, 0.02]), np.array([0.0, 2000.0, 2000.0, -500.0])),
    "sine": (np.linspace(0.0, 0.02, 801), RINGING),
    "free for a while": (np.array([0.0, 1e-5, 0.02]), np.array([0.0, 400.0, 4400.0])),
}
QUANTITIES = {
    "series_resistance": Quantity(954.0, "ohm"),
    "leakage_resistance": Quantity(1e9, "ohm"),
    "capacitance": Quantity(180e-9, "F", 2e-9),
}
SPECIMEN = Specimen(
    "tube", "tubular", {"kind": "simulated"}, QUANTITIES, {"current_limit": Quantity(0.12, "A")}
)


def integrated(
    amplifier: Amplifier, time: FloatArray, command: FloatArray, at: FloatArray
) -> FloatArray:
    """The output by a stiff solver, the current cut at every evaluation."""

    def current(now: FloatArray | float, charged: FloatArray) -> FloatArray:
        asked = (np.interp(now, time, command) - charged) / amplifier.series_resistance
        return np.clip(asked, -amplifier.limit, amplifier.limit)

    def slope(now: float, charged: FloatArray) -> FloatArray:
        leaking = charged / amplifier.leakage_resistance
        return (current(now, charged) - leaking) / amplifier.capacitance

    found = solve_ivp(
        slope, (time[0], time[-1]), [0.0], "Radau", at, max_step=1e-5, rtol=1e-10, atol=1e-8
    )
    return found.y[0] + amplifier.series_resistance * current(at, found.y[0])


@pytest.mark.parametrize("amplifier", [TUBE, LEAKY], ids=["tube", "leaky"])
@pytest.mark.parametrize("name", COMMANDS)
def test_the_output_is_that_of_the_cut_circuit(amplifier: Amplifier, name: str) -> None:
    time, command = COMMANDS[name]
    times, values, limited = amplifier.output(time, command)
    assert limited > 1e-4
    assert np.all(np.diff(times) >= 0.0)
    at = np.sort(np.random.default_rng(1).uniform(0.0, 0.02, 300))
    expected = integrated(amplifier, time, command, at)
    assert np.interp(at, times, values) == pytest.approx(expected, abs=2e-6 * np.abs(command).max())


def test_charging_takes_what_the_limit_says() -> None:
    """Up to u - R_S I the current is I: without a leak for C (u - R_S I) / I."""
    tight = Amplifier(0.12, 954.0, 1e15, 180e-9)
    _, _, limited = tight.output(np.array([0.0, 0.0, 0.1]), np.array([0.0, 2000.0, 2000.0]))
    assert limited == pytest.approx(180e-9 * (2000.0 - 954.0 * 0.12) / 0.12, rel=1e-8)


def test_a_command_that_it_can_follow_is_the_output() -> None:
    time, command = COMMANDS["sine"]
    times, values, limited = Amplifier(10.0, 954.0, 1e9, 180e-9).output(time, command)
    assert limited == 0.0
    assert (times, values) == (time.tolist(), command.tolist())


def test_it_follows_again_to_the_very_command() -> None:
    times, values, _ = TUBE.output(*COMMANDS["up and down"])
    assert len(times) == 7, "the limit is met once and left once"
    assert np.interp(0.009, times, values) == pytest.approx(2000.0, rel=1e-12)
    assert values[-1] == pytest.approx(-500.0, rel=1e-12)


def test_a_jump_leaves_the_charge_alone() -> None:
    times, values, _ = TUBE.output(np.array([0.0, 0.05, 0.05]), np.array([1000.0, 1000.0, 0.0]))
    assert values[0] == pytest.approx(0.12 * 954.0)
    assert (times[-2:], values[-2]) == ([0.05, 0.05], 1000.0)
    assert values[-1] == pytest.approx(1000.0 - 0.12 * 954.0, abs=2e-3)


def test_the_sign_of_the_voltage_does_not_matter() -> None:
    time, command = COMMANDS["up and down"]
    times, values, limited = TUBE.output(time, command)
    mirrored = TUBE.output(time, -command)
    assert mirrored == (times, [-value for value in values], limited)


def recorded(
    *steps: object, specimen: Specimen = SPECIMEN, excitation: str = "voltage"
) -> Experiment:
    """Creep under a command of 2 kV at 10 ms, sampled at 10 kHz."""
    time = np.arange(1001) * 1e-4
    command = np.where(time < 0.01, 0.0, 2000.0)
    unit = "Hz" if excitation == "frequency" else "V"
    raw = RawRecord(
        {"time": time, excitation: command, "strain": 1e-5 * time},
        {"time": "s", excitation: unit, "strain": "1"},
        "ab" * 32,
    )
    row = ExperimentRow("a", "creep", "a.csv", "calibrate", excitation, "strain", {})
    return prepare(row, checked(row, raw, specimen), specimen, list(steps))  # type: ignore[arg-type]


def test_the_step_puts_the_output_in_place_of_the_command() -> None:
    before, after = recorded(), recorded({"limit_current": {}})
    drive = after.excitation
    expected = TUBE.output(before.excitation.coordinate, before.excitation.values)
    assert drive.coordinate.tolist() == expected[0]
    assert drive.values.tolist() == expected[1]
    assert np.array_equal(after.response, before.response)
    assert "at its limit for 2.8" in str(after.steps[0]["effect"])
    half = recorded({"limit_current": {"limit": "60 mA", "capacitance": "90 nF"}}).excitation
    rise = half.at(np.array([0.0115])) - half.at(np.array([0.0105]))
    assert rise == pytest.approx(1e-3 * 0.06 / 90e-9, rel=1e-3)


def test_a_control_voltage_is_the_command() -> None:
    expected = recorded({"limit_current": {}}).excitation
    given = recorded({"limit_current": {}}, excitation="control_voltage")
    assert given.excitation.name == "voltage"
    assert given.excitation.conditions == expected.conditions
    assert np.array_equal(given.excitation.values, expected.values)
    assert "control_voltage is a command to the amplifier" in given.warnings[0]


def test_mistakes_are_named() -> None:
    nothing = Specimen("tube", "tubular", {}, QUANTITIES)
    with pytest.raises(UserError, match="current_limit"):
        recorded({"limit_current": {}}, specimen=nothing)
    without = {name: value for name, value in QUANTITIES.items() if name != "capacitance"}
    bare = Specimen("tube", "tubular", {}, without, SPECIMEN.instruments)
    with pytest.raises(UserError, match="give capacitance"):
        recorded({"limit_current": {}}, specimen=bare)
    with pytest.raises(UserError, match="larger than 0"):
        recorded({"limit_current": {"limit": "0 mA"}})
    with pytest.raises(UserError, match="unknown setting"):
        recorded({"limit_current": {"limits": "1 mA"}})
    with pytest.raises(UserError, match="frequency"):
        recorded({"limit_current": {}}, excitation="frequency")


def test_a_record_that_begins_late_is_followed_like_any_other() -> None:
    """A day into a clock, a step of the clock's last digit is longer than the amplifier's."""
    time, command = COMMANDS["sine"]
    _, expected, limited = LEAKY.output(time, command)
    times, values, late = LEAKY.output(time + 1e5, command)
    assert late == pytest.approx(limited, rel=1e-6)
    at = 1e5 + np.linspace(0.0, 0.02, 50)
    shifted = np.interp(at, times, values)
    assert shifted == pytest.approx(
        np.interp(at - 1e5, LEAKY.output(time, command)[0], expected), abs=5e-3
    )


def test_any_load_and_command_comes_to_an_end() -> None:
    rng = np.random.default_rng(0)
    for _ in range(60):
        powers = rng.uniform([-6.0, -6.0, 3.0, -12.0], [0.0, 6.0, 14.0, -5.0])
        count = int(rng.integers(6, 200))
        time = np.sort(rng.uniform(0.0, 10.0 ** rng.uniform(-3.0, 4.0), count)) + 1e5
        time[3] = time[2]
        command = 10.0 ** rng.uniform(1.0, 4.0) * rng.standard_normal(count).cumsum()
        times, values, limited = Amplifier(*(10.0**powers).tolist()).output(time, command)
        assert np.isfinite(values).all() and np.all(np.diff(times) >= 0.0)
        assert 0.0 <= limited <= np.ptp(time) * (1.0 + 1e-9)
