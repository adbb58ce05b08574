"""What Sarban et al. (2012) print of circuit and loads, where it survives in the text."""

from __future__ import annotations

PHASE, PHASE_RESOLUTION = 1.56, 0.01
"""By which the current leads the voltage at FREQUENCY [rad], and the digits it is printed with."""
FREQUENCY = 10.0
"""[Hz]."""
LOADS = (0.0, 100.0, 300.0, 500.0)
"""[g]."""
