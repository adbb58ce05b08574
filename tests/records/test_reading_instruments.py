"""Instruments of specimen.yaml: what is under no channel that has it is refused."""

from __future__ import annotations

import pytest

from deabayes.faults import Report
from deabayes.records.specimen import read_instruments

MS, ZERO = {"value": 2, "unit": "ms"}, {"value": 0, "unit": "ms"}
LIMIT = {"value": 5, "unit": "mA"}


def found(system: str, **instruments: object) -> tuple[dict[str, float], list[str]]:
    """Values by property, and faults."""
    report = Report()
    content = {"system": system, "instruments": instruments}
    read = read_instruments(content, "specimen.yaml", report)
    return {name: quantity.value for name, quantity in read.items()}, report.faults


@pytest.mark.parametrize(
    ("system", "channel", "known"),
    [
        ("membrane", "voltage", "stretch, displacement, area"),
        ("tubular", "voltage", "strain, displacement, current, phase"),
        ("tubular", "control_voltage", "strain, displacement, current, phase"),
        ("tubular", "frequency", "strain, displacement, current, phase"),
        ("tubular", "gain", "strain, displacement, current, phase"),
        ("tensile_strip", "displacement", "nominal_stress, force"),
    ],
)
def test_a_delay_of_what_is_no_response_is_refused(system: str, channel: str, known: str) -> None:
    """No step takes it out of anything."""
    (fault,) = found(system, **{channel: {"delay": MS}})[1]
    assert fault.startswith(f"specimen.yaml, instruments.{channel}.delay: a delay is taken out")
    assert f"{system!r} responds with ({known}), not of its {channel};" in fault


@pytest.mark.parametrize(
    ("system", "channel"),
    [
        ("membrane", "area"),
        ("tubular", "current"),
        ("tubular", "phase"),
        ("minimum_energy_structure", "displacement"),  # an excitation, too
        ("unknown", "voltage"),  # which is said of the system
    ],
)
def test_a_delay_of_a_response(system: str, channel: str) -> None:
    assert found(system, **{channel: {"delay": MS}}) == ({f"{channel}.delay": 2e-3}, [])


def test_no_delay_is_none_of_any_channel() -> None:
    assert found("membrane", voltage={"delay": ZERO}) == ({"voltage.delay": 0.0}, [])


@pytest.mark.parametrize("channel", ["voltage", "control_voltage", "displacement"])
def test_a_limit_of_the_current_under_another_channel_is_refused(channel: str) -> None:
    (fault,) = found("tubular", **{channel: {"current_limit": LIMIT}})[1]
    assert f"instruments.{channel}.current_limit: it is the current that is limited" in fault
    assert "put it under `current:`, or under no channel" in fault


def test_a_limit_of_the_current() -> None:
    assert found("tubular", current={"current_limit": LIMIT}) == (
        {"current.current_limit": 5e-3},
        [],
    )
    assert found("tubular", current_limit=LIMIT) == ({"current_limit": 5e-3}, [])


def test_all_faults_come_together() -> None:
    given = {"voltage": {"delay": MS, "current_limit": LIMIT}, "force": {"noise": MS}}
    assert len(found("tubular", **given)[1]) == 3
