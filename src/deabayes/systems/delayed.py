r"""A sensor that shows what was a while ago, where that while is not known exactly.

With the stated delay T_0 and its sd s, the response is computed at t - T_0 and at
t - T_0 +- 2 s, and read at t - T by the parabola through the three. That is exact for a
parabola; of a response that oscillates at omega the error is about (2 s omega)^3 / 16 of its
amplitude within 2 s of T_0: 4e-6 for 0.05 ms at 62 Hz. No parabola follows a jump: what answers
the excitation at once is read at t - T itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import Excitation, FloatArray, Quantity
from deabayes.systems.base import Draws, Simulator
from deabayes.systems.circuit import Circuit

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
        x = (delays - delay.value) / spacing
        nodes = np.moveaxis(simulate(draws)[:, places.reshape(happened.shape)], 1, 0)
        late, own = _parabola(x, nodes), coordinate - delays
        if at_once is not None:
            late += at_once(draws, own)
        return np.asarray(late * (own >= start))

    return simulate_late


def series_spring(
    excitation: Excitation,
    gain: Callable[[Draws], FloatArray],
    circuit_of: Callable[[Draws], Circuit] | None,
) -> AtOnce:
    """That of a chain without mass: gain (W,) times v^2, or v_C^2 behind a circuit."""
    knots, values = excitation.coordinate, excitation.values

    def strain(draws: Draws, times: FloatArray) -> FloatArray:
        if circuit_of is None:
            voltage = excitation.at(times)
        else:
            voltage = circuit_of(draws).charge(knots, values, times)
        return np.asarray(gain(draws)[:, None] * voltage**2)

    return strain


def _parabola(x: FloatArray, nodes: FloatArray) -> FloatArray:
    """At x (W, 1) through values (3, ...) at -1, 0 and 1."""
    before, middle, after = nodes
    return np.asarray(
        0.5 * x * (x - 1.0) * before + (1.0 - x**2) * middle + 0.5 * x * (x + 1.0) * after
    )
