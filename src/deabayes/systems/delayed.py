r"""A sensor that shows what was a while ago, where that while is not known exactly.

With the stated delay T_0 and its sd s, the response is computed at t - T_0 and at
t - T_0 +- 2 s, and read at t - T by the parabola through the three. That is exact for a
parabola; of a response that oscillates at omega the error is about (2 s omega)^3 / 16 of its
amplitude within 2 s of T_0: 4e-6 for 0.05 ms at 62 Hz. No parabola follows a jump: what answers
the excitation at once is read at t - T itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from deabayes.experiment import FloatArray, Quantity
from deabayes.systems.base import Draws, Simulator

REACH = 2.0
"""Half the distance of the outer nodes, in sds."""


class AtOnce(NamedTuple):
    """The part of a response that follows the excitation at once."""

    signal: Callable[[FloatArray], FloatArray]
    """At times of any shape, jumps included."""
    gain: Callable[[Draws], FloatArray]
    """What the draws (W,) multiply it by."""


def delayed(
    simulator_at: Callable[[FloatArray], Simulator],
    coordinate: FloatArray,
    delay: Quantity,
    name: str,
    start: float,
    at_once: AtOnce | None = None,
) -> Simulator:
    """The simulator of a response that is seen late.

    Parameters
    ----------
    simulator_at : the simulator of what happens, at given ascending times.
    coordinate : (N,) when it was seen [s].
    delay : as the specimen states it; with an sd, draws hold it as `name` (W,).
    start : when the excitation begins; what is seen of before is zero, even where the
        response jumps then.
    at_once : what of the response jumps later on, None where nothing does.
    """
    if delay.sd is None:
        begun = coordinate - delay.value >= start
        simulate_exact = simulator_at(np.maximum(coordinate - delay.value, start))
        return lambda draws: simulate_exact(draws) * begun
    spacing = REACH * delay.sd
    nodes = delay.value + spacing * np.array([-1.0, 0.0, 1.0])
    happened = np.maximum(coordinate - nodes[:, None], start)
    times, places = np.unique(happened, return_inverse=True)
    simulate = simulator_at(times)

    def simulate_late(draws: Draws) -> FloatArray:
        delays = draws[name][:, None]
        x = (delays - delay.value) / spacing
        nodes = np.moveaxis(simulate(draws)[:, places.reshape(happened.shape)], 1, 0)
        late = _parabola(x, nodes)
        if at_once is not None:
            read = _parabola(x, at_once.signal(happened))
            late += at_once.gain(draws)[:, None] * (at_once.signal(coordinate - delays) - read)
        begun = coordinate - delays >= start
        return np.asarray(late * begun)

    return simulate_late


def _parabola(x: FloatArray, nodes: FloatArray) -> FloatArray:
    """At x (W, 1) through values (3, ...) at -1, 0 and 1."""
    before, middle, after = nodes
    return np.asarray(
        0.5 * x * (x - 1.0) * before + (1.0 - x**2) * middle + 0.5 * x * (x + 1.0) * after
    )
