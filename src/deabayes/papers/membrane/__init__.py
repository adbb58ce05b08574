"""Values printed by Nguyen et al. (2021), as far as they survive in the text.

The keys 1, 2 and 3 are numbers of Maxwell units.
"""

from __future__ import annotations

from collections.abc import Mapping

OVERSHOOT = 5.0
"""Seconds after the step that the paper excludes from the error of the step."""
STEP_VOLTAGE, SINE_FREQUENCY = 4.0, 0.05
"""Voltage [kV] and frequency [Hz] of the records whose parameters the paper lists.

Table 1 is compared with these records."""
STEP_E_M: Mapping[object, float] = {1: 21.42, 2: 9.936, 3: 3.762}
"""Table 1, step: e_m after the overshoot [%]."""
STEP_OVERSHOOT: Mapping[object, float] = {1: 8.841, 2: 10.26, 3: 8.931}
"""Errors within the overshoot [%]."""
ALTERNATING_E_RMS: Mapping[object, float] = {1: 15.796, 2: 11.553, 3: 9.03}
"""Table 1, alternating voltage: e_rms [%]."""
AREA = {2.0: (1.113, 6.149), 3.0: (1.315, 6.349), 4.0: (1.674, 7.485)}
"""Table 2: largest area error and error of the camera [%], by voltage [kV]."""
STEADY_STRETCH = {2.0: 3.085, 3.0: 3.210, 4.0: 3.441}
"""Not printed: equilibria of the paper's parameters and stand-in Gent limits, by voltage [kV]."""
