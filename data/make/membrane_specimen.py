"""specimen.yaml of the reference membrane: what its experimenter would know."""

from __future__ import annotations

from data.make.writing import quantity

STAND_IN = "stand-in, not in the paper's text"
PAPER = "Nguyen et al. 2021"

PROVENANCE = (
    "Simulated by data.make.membrane with scipy's Radau: KV-GM with the step "
    "parameters of Nguyen et al. (2021; moduli and relaxation times 6/50/125 s from the text, "
    "Gent limits stand-ins) and a fourth, slow Maxwell unit (900 s) that the candidates of "
    "order 1 to 3 leave out, behind an amplifier limited to 5 uA that takes tenths of a "
    "second to charge the membrane, read by a sensor with delay, offset, drift, "
    "Ornstein-Uhlenbeck and white noise and 16-bit quantisation, and by a camera (area)."
)


SPECIMEN: dict[str, object] = {
    "name": "membrane",
    "system": "membrane",
    "provenance": {"kind": "simulated", "source": PROVENANCE, "licence": "BSD-3-Clause"},
    "quantities": {
        "side_length": quantity(10, "mm", PAPER),
        "thickness": quantity(1, "mm", PAPER + "; its error is in that of permittivity"),
        "permittivity": quantity(
            41.1, "pF/m", PAPER + "; sd is a stand-in: VHB 4910, 4.6 to 4.8 times epsilon_0", 0.9
        ),
        "prestretch": quantity(3, "1", PAPER + "; taken as exact"),
        "density": quantity(960, "kg/m^3", PAPER),
        "breakdown_stretch": quantity(6, "1", STAND_IN),
    },
    "instruments": {
        "delay": {"value": 2, "unit": "ms"},
        "range": {"value": 10, "unit": "mm"},
        "resolution": {"value": 0.1526, "unit": "um"},
        "noise": {"value": 2, "unit": "um"},
        "current_limit": {"value": 5, "unit": "uA"},
        "area": {
            "delay": {"value": 0, "unit": "ms"},
            "resolution": {"value": 0.1, "unit": "mm^2"},
            "noise": {"value": 1.5, "unit": "mm^2"},
        },
    },
}
