"""Integration of the membrane with inertia, Nguyen et al. 2021 (14), and choice of the kernel."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate import arrow, rodas5p
from deabayes.integrate.arrow import IndexArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, transformed_coefficients
from deabayes.systems.membrane import kernel as of
from deabayes.systems.membrane.kernel import resistance, slopes

A, C, _ = transformed_coefficients()
NODES, DRIFTS = np.array(rodas5p.NODES), np.array(rodas5p.D)
DENSE = np.array([rodas5p.H2, rodas5p.H3, rodas5p.H4])
GAMMA = rodas5p.GAMMA


@njit(**KERNEL_OPTIONS)
def _voltage(volts: FloatArray, x: float) -> tuple[float, float]:
    """Return the voltage and its slope on a piece, at the fraction `x` of the piece."""
    value, slope = volts[-1], 0.0
    for power in range(volts.size - 2, -1, -1):
        slope = slope * x + value
        value = value * x + volts[power]
    return value, slope


@njit(**KERNEL_OPTIONS)
def _force(y: FloatArray, drive: float, draw: FloatArray, units: FloatArray) -> float:
    """Return the force F [Pa] at the state y = (lambda, v, xi_1..n)."""
    lam = y[0]
    total = drive * lam**3 + draw[of.OF_SIGMA]
    total -= draw[of.OF_MODULUS] * resistance(lam, 1.0, draw[of.OF_INVERSE])
    for n in range(units.shape[0]):
        total -= units[n, 2] * y[n + 2] * resistance(lam, y[n + 2], units[n, 3])
    return total


@njit(**KERNEL_OPTIONS)
def _step(
    y: FloatArray,
    u: FloatArray,
    h: float,
    x: float,
    span: float,
    volts: FloatArray,
    draw: FloatArray,
    units: FloatArray,
    mass: float,
) -> None:
    """Compute increments u (8, n + 2) of a step from y (n + 2,) at the fraction x of a piece."""
    count, viscosity = units.shape[0], 1.0 / draw[of.OF_FLUIDITY]
    gain, lam = draw[of.OF_GAIN], y[0]
    hm = h / mass
    value, slope = _voltage(volts, x)
    drift = h * hm * 2.0 * gain * value * slope * span * lam**3
    _, by_lam, _ = slopes(lam, 1.0, draw[of.OF_INVERSE])
    stiffness = 3.0 * gain * value * value * lam * lam - draw[of.OF_MODULUS] * by_lam
    solve, below, beside = np.empty(count), np.empty(count), np.empty(count)
    coupled = 0.0
    for n in range(count):
        xi, rate = y[n + 2], h * units[n, 1]
        r, by_lam, by_xi = slopes(lam, xi, units[n, 3])
        stiffness -= units[n, 2] * xi * by_lam
        solve[n] = 1.0 / (1.0 / GAMMA - rate * lam * by_xi)
        below[n] = rate * (r + lam * by_lam)
        beside[n] = -units[n, 2] * (r + xi * by_xi)
        coupled += beside[n] * below[n] * solve[n]
    damping = 1.0 / GAMMA + hm * viscosity
    pivot = damping / (GAMMA * h) - hm * (stiffness + coupled)
    at, right = np.empty(count + 2), np.empty(count + 2)
    for s in range(8):
        for k in range(count + 2):
            at[k], right[k] = y[k], 0.0
            for j in range(s):
                at[k] += A[s, j] * u[j, k]
                right[k] += C[s, j] * u[j, k]
        value, _ = _voltage(volts, x + NODES[s] * h * span)
        right[0] += h * at[1]
        force = _force(at, gain * value * value, draw, units)
        right[1] += hm * (force - viscosity * at[1]) + DRIFTS[s] * drift
        total = right[1] + damping * right[0] / h
        for n in range(count):
            rate = h * units[n, 1]
            right[n + 2] += rate * at[0] * resistance(at[0], at[n + 2], units[n, 3])
            total += hm * beside[n] * right[n + 2] * solve[n]
        u[s, 0] = total / pivot
        u[s, 1] = (u[s, 0] / GAMMA - right[0]) / h
        for n in range(count):
            u[s, n + 2] = (right[n + 2] + below[n] * u[s, 0]) * solve[n]


@njit(**KERNEL_OPTIONS)
def _follow(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draw: FloatArray,
    units: FloatArray,
    mass: float,
    stretch: FloatArray,
) -> tuple[int, float]:
    """Compute the stretch (N,) of a draw; return steps tried and time of failure (NaN if none)."""
    count = units.shape[0]
    y, u, dense = np.full(count + 2, draw[arrow.OF_START]), np.empty((8, count + 2)), np.empty(3)
    y[1] = 0.0
    now, piece, output, tried = edges[0], 0, 0, 0
    first = min(draw[arrow.OF_STEP], mass * draw[of.OF_FLUIDITY])
    proposed = first
    while output < times.size:
        if tried > of.MOST_STEPS + 4 * restart.size or proposed < arrow.FINEST * first:
            stretch[:] = np.nan
            return tried, now
        tried += 1
        after = edges[piece + 1]
        span = 1.0 / (after - edges[piece])
        h = arrow.fitted_step(proposed, after - now)
        _step(y, u, h, (now - edges[piece]) * span, span, volts[piece], draw, units, mass)
        error = abs(u[7, 0])
        for n in range(count):
            error += units[n, 4] * abs(u[7, n + 2])
        error *= draw[arrow.OF_ALLOWED]
        factor = arrow.growth(error)
        if not error <= 1.0:
            proposed = h * min(factor, 0.8)
            continue
        begin = y[0]
        for k in range(count + 2):
            for j in range(5):
                y[k] += A[7, j] * u[j, k]
            y[k] += u[5, k] + u[6, k] + u[7, k]
        for r in range(3):
            dense[r] = 0.0
            for j in range(8):
                dense[r] += DENSE[r, j] * u[j, 0]
        last = h == after - now
        reached = after if last else now + h
        output = arrow.write_outputs(
            times, output, now, h, reached, begin, y[0], dense[0], dense[1], dense[2], stretch
        )
        if not y[0] <= draw[arrow.OF_HIGH]:
            stretch[:] = np.nan
            return tried, reached
        now = reached
        proposed = max(h * factor, proposed) if h < proposed else h * factor
        if last and piece < restart.size - 1:
            piece += 1
            if restart[piece] > 0.0:
                proposed = min(proposed, first)
    return tried, np.nan


@njit(**KERNEL_OPTIONS)
def integrate_with_inertia(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    mass: FloatArray,
    stretch: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Like `kernel.integrate`, with the mass rho L^2/3 [Pa s^2], (W,); starts at rest."""
    for w in range(draws.shape[0]):
        if arrow.usable(draws[w], units[w]) and np.isfinite(mass[w]):
            steps[w], ended[w] = _follow(
                edges, volts, restart, times, draws[w], units[w], mass[w], stretch[w]
            )
        else:
            stretch[w] = np.nan
            steps[w], ended[w] = 0, edges[0]
