r"""A sensor that lags by a delay that is not known exactly.

With the stated delay T_0 and its sd s, the response is computed at t - T_0 and at t - T_0 +- 2 s.
The parabola through these three values gives the response at t - T, with T the delay of a draw.
For a response that is a parabola this is exact. For a response that oscillates at omega and T
within 2 s of T_0, the error is about (2 s omega)^3 / 16 of the amplitude: 4e-6 for 0.05 ms at
62 Hz. A parabola cannot follow a jump: the part of the response that follows the excitation at
once is computed at t - T directly. At a kink, where the slope changes by D, the error of one or
two samples is up to 0.38 s D. For a Kelvin unit with time constant tau after a jump this is
0.38 s / tau of its final strain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import FloatArray, Quantity
from deabayes.systems.base import Draws, Simulator

REACH = 2.0
"""Half the distance between the outer nodes, in sds of the delay."""


AtOnce = Callable[[Draws, FloatArray], FloatArray]
"""The part of a response (W, N) that follows the excitation at once: a function of draws (W,)
and of times (W, N), which differ between draws."""


def shifted(
    simulator_at: Callable[[FloatArray], Simulator],
    coordinate: FloatArray,
    delay: float,
    start: float,
) -> Simulator:
    """Simulator of a response that a sensor shows late by an exactly known delay [s]."""
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
    """Simulator of a response that a sensor shows late by a delay that is not known exactly.

    Parameters
    ----------
    smooth_at : gives the simulator of the response without `at_once`, at given ascending times.
    coordinate : (N,) times at which the sensor shows the response [s].
    delay : the delay that the specimen states, with an sd; the draws (W,) have the key `name`.
    start : time at which the excitation begins [s]; before it the response is zero, also if the
        response jumps there.
    at_once : part of the response that is computed without the parabola; None if there is none.
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
    """Weights (W, 1, 3) of values at -1, 0 and 1 for the parabola through them, at x (W, 1)."""
    return np.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=2)
