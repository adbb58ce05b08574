r"""A sensor that shows what was a while ago, where that while is not known exactly.

With the stated delay T_0 and its sd s, the response is computed at t - T_0 and at
t - T_0 +- 2 s, and read at t - T by the parabola through the three. That is exact for a
parabola; of a response that oscillates at omega the error is about (2 s omega)^3 / 16 of its
amplitude within 2 s of T_0: 4e-6 for 0.05 ms at 62 Hz. No parabola follows a jump: what answers
the excitation at once is read at t - T itself. A kink, where the slope changes by D, costs up to
0.38 s D for a sample or two: 0.38 s / tau of the strain that a Kelvin unit of time constant tau
goes for at a jump.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import FloatArray, Quantity
from deabayes.systems.base import Draws, Simulator

REACH = 2.0
"""Half the distance of the outer nodes, in sds."""


AtOnce = Callable[[Draws, FloatArray], FloatArray]
"""The part of a response (W, N) that follows the excitation at once, of draws (W,) at each one's
own times (W, N)."""


def shifted(
    simulator_at: Callable[[FloatArray], Simulator],
    coordinate: FloatArray,
    delay: float,
    start: float,
) -> Simulator:
    """The simulator of a response that is seen late by a delay [s] known exactly; see `delayed`."""
    begun = coordinate - delay >= start
    simulate = simulator_at(np.maximum(coordinate - delay, start))
    return lambda draws: simulate(draws) * begun


def delayed(
    smooth_at: Callable[[FloatArray], Simulator],
    coordinate: FloatArray,
    delay: Quantity,
    name: str,
    start: float,
    at_once: AtOnce | None = None,
) -> Simulator:
    """The simulator of a response that is seen late by what is not known exactly.

    Parameters
    ----------
    smooth_at : the simulator of what happens, without `at_once`, at given ascending times.
    coordinate : (N,) when it was seen [s].
    delay : as the specimen states it, with an sd; draws hold it as `name` (W,).
    start : when the excitation begins; what is seen of before is zero, even where the
        response jumps then.
    at_once : what of the response the parabola must not read, None where it reads all.
    """
    assert delay.sd is not None
    spacing = REACH * delay.sd
    nodes = delay.value + spacing * np.array([-1.0, 0.0, 1.0])
    happened = np.maximum(coordinate - nodes[:, None], start)
    times, places = np.unique(happened, return_inverse=True)
    simulate = smooth_at(times)

    def simulate_late(draws: Draws) -> FloatArray:
        delays = draws[name][:, None]
        at_nodes = simulate(draws).take(places.reshape(happened.shape), axis=1)
        late = (_weights((delays - delay.value) / spacing) @ at_nodes)[:, 0]
        own = coordinate - delays
        if at_once is not None:
            late += at_once(draws, own)
        return np.asarray(late * (own >= start))

    return simulate_late


def _weights(x: FloatArray) -> FloatArray:
    """Of values at -1, 0 and 1, for the parabola through them at x (W, 1): (W, 1, 3)."""
    return np.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=2)
