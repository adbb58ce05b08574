"""Circuit and loads as printed by Sarban et al. (2012), as far as they survive in the text."""

from __future__ import annotations

PHASE, PHASE_RESOLUTION = 1.56, 0.01
"""Phase [rad] by which the current leads the voltage at FREQUENCY, and its rounding."""
FREQUENCY = 10.0
"""Frequency of the sine whose phase is PHASE [Hz]."""
LOADS = (0.0, 100.0, 300.0, 500.0)
"""Loads of the paper [g]."""
