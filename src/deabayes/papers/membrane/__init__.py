"""What Nguyen et al. (2021) print, where it survives in the text: by number of Maxwell units."""

from __future__ import annotations

OVERSHOOT = 5.0
"""Seconds after the step within which the paper leaves the error of the step out."""
STEP_VOLTAGE, SINE_FREQUENCY = 4.0, 0.05
"""[kV], [Hz] of the records whose parameters the paper lists; Table 1 is set beside these."""
STEP_E_M = {1: 21.42, 2: 9.936, 3: 3.762}
"""Table 1, step: e_m after the overshoot [%]."""
STEP_OVERSHOOT = {1: 8.841, 2: 10.26, 3: 8.931}
"""Errors within the overshoot [%]."""
ALTERNATING_E_RMS = {1: 15.796, 2: 11.553, 3: 9.03}
"""Table 1, alternating voltage: e_rms [%]."""
AREA = {2.0: (1.113, 6.149), 3.0: (1.315, 6.349), 4.0: (1.674, 7.485)}
"""Table 2: voltage [kV] -> largest area error, and that of the camera [%]."""
STEADY_STRETCH = {2.0: 3.085, 3.0: 3.210, 4.0: 3.441}
"""Not printed: equilibria of the paper's parameters, Gent limits stand-ins, by voltage [kV]."""


def near(value: float, printed: float, tolerance: float = 0.02) -> bool:
    """Whether a record's voltage or frequency is that of a printed figure."""
    return abs(value - printed) <= tolerance * printed
