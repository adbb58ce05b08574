"""specimen.yaml of the reference tubular actuator: what its experimenter would know."""

from __future__ import annotations

from data.make.writing import quantity

STAND_IN = "stand-in, not in the paper's text"

PROVENANCE = (
    "Simulated by data.make.tubular, in time with scipy's DOP853, in frequency by "
    "harmonic balance: three Kelvin units with stand-in constants for the actuator of Sarban, "
    "Lassen and Willatzen (2012), of which the third is slow (1.5 s), moving the masses of (13), "
    "so that it rings at tens of hertz, behind an amplifier limited to 120 mA that takes "
    "milliseconds to charge the capacitance through its series resistance; a dielectric that "
    "goes on absorbing charge for tens of seconds; a displacement sensor with 0.4 ms delay, and "
    "offset, drift, Ornstein-Uhlenbeck and white noise and quantisation in what is read."
)


SPECIMEN: dict[str, object] = {
    "name": "tubular",
    "system": "tubular",
    "provenance": {"kind": "simulated", "source": PROVENANCE, "licence": "BSD-3-Clause"},
    "quantities": {
        "thickness": quantity(80, "um", "Sarban et al. 2012, laminate; sd is a stand-in", 2),
        "relative_permittivity": quantity(3.1, "1", STAND_IN, 0.1),
        "active_length": quantity(70, "mm", STAND_IN + "; taken as exact"),
        "cross_section": quantity(6.0e-4, "m^2", STAND_IN, 0.15e-4),
        "total_mass": quantity(100.5, "g", "Sarban et al. 2012"),
        "active_mass": quantity(
            46.2, "g", "1100 kg/m^3 (stand-in) x cross_section x length; sd is a stand-in", 1
        ),
        "sensor_mass": quantity(10, "g", STAND_IN, 0.5),
        "series_resistance": quantity(
            954,
            "ohm",
            "phase of 1.56 rad at 10 Hz (Sarban et al. 2012); its rounding allows 510 to 1390 ohm",
            250,
        ),
        "leakage_resistance": quantity(1.0, "Gohm", STAND_IN, 0.2),
        "capacitance": quantity(180, "nF", STAND_IN, 2),
    },
    "instruments": {
        "delay": {"value": 0.4, "unit": "ms"},
        "range": {"value": 5, "unit": "mm"},
        "resolution": {"value": 0.2, "unit": "um"},
        "noise": {"value": 1.4, "unit": "um"},
        "current_limit": {"value": 120, "unit": "mA"},
        "current": {"delay": {"value": 0, "unit": "ms"}},
    },
}
