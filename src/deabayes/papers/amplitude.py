"""Peak-to-peak displacement of the settled response to a periodic voltage."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import Excitation, FloatArray
from deabayes.papers.base import StudyContext, band
from deabayes.posteriors.fitted import Fitted

PHASES, KNOTS = 48, 100
"""Points of the response and knots of the voltage per cycle."""
Wave = Callable[[FloatArray], FloatArray]
"""Voltage [V] as a function of the cycles since rest."""


def settled_bands(
    context: StudyContext, frequencies: FloatArray, wave: Wave, cycles: int, last: int, draws: int
) -> FloatArray:
    """Bands (candidate, bound, F) of the settled amplitude at frequencies (F,) [m].

    Parameters
    ----------
    cycles, last : number of cycles from rest, and of the last ones whose amplitudes are averaged.
    draws : number of draws to use.
    """

    def of(fitted: Fitted, frequency: float) -> FloatArray:
        return band(settled_amplitude(fitted, frequency, wave, cycles, last, draws))

    return np.array([
        np.stack([of(fitted, frequency) for frequency in frequencies], axis=1)
        for fitted in context.candidates.values()
    ])  # fmt: skip


def settled_amplitude(
    fitted: Fitted, frequency: float, wave: Wave, cycles: int, last: int, draws: int
) -> FloatArray:
    """Mean peak-to-peak displacement (S,) of the last cycles [m] (see `settled_bands`).

    Draws without a finite response are left out.
    """
    turns = np.arange(cycles * KNOTS + 1) / KNOTS
    drive = Excitation("voltage", "V", turns / frequency, wave(turns))
    last = min(last, cycles)
    times = (cycles - last + np.arange(last * PHASES + 1) / PHASES) / frequency
    first_draws = {name: values[:draws] for name, values in fitted.draws.items()}
    curves = fitted.system.predict(drive, times, "displacement", first_draws)
    curves = curves[np.all(np.isfinite(curves), axis=1)]
    parts = [curves[:, k * PHASES : (k + 1) * PHASES + 1] for k in range(last)]
    return np.asarray(np.mean([np.ptp(part, axis=1) for part in parts], axis=0))
