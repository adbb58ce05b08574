r"""Exact step of a linear system under a polynomial input: its propagators.

z' = A z + B w with w = p0 + p1 u + p2 u^2 on a step of length h (u = s / h in [0, 1]):

z(h) = z(0) + E z(0) + p0 G_0 + p1 G_1 + p2 G_2,   E = exp(A h) - 1,
G_k = \int_0^h exp(A (h - s)) B (s / h)^k ds = h \sum_j (A h)^j B k! / (j + k + 1)!.

The series is summed for h / 2^m, where it converges fast, and the step doubled m times:

E <- 2 E + E^2,   G_0 <- E G_0 + 2 G_0,   G_1 <- E G_1 / 2 + G_1 + G_0 / 2,
G_2 <- (E G_2 + 2 G_2 + 2 G_1 + G_0) / 4   (right-hand sides: before the doubling).

Doubling E rather than exp(A h) keeps what a slow state moves in a short step, where
1 + E would round it away (as expm1 does for a number).
"""

from __future__ import annotations

import math

from deabayes.compiled import njit

SMALL_NORM = 0.5
TERMS = 16
"""SMALL_NORM^16 / 16! is 7e-19: the series is complete."""
MOST_DOUBLINGS = 60


@njit(cache=True)
def fill_propagator(a, b, length, scratch, step, drive) -> None:  # type: ignore[no-untyped-def]
    """Fill E (n, n) and G (n, 3) for A (n, n), B (n,) and one length; NaN if not finite.

    scratch (2, n, n + 1) is overwritten.
    """
    doublings = _doublings(a, length)
    if doublings < 0:
        step[:] = math.nan
        drive[:] = math.nan
        return
    _series(a, b, length * 2.0**-doublings, scratch, step, drive)
    for _ in range(doublings):
        _double(scratch[0], step, drive)


@njit(cache=True)
def _doublings(a, length) -> int:  # type: ignore[no-untyped-def]
    """Halvings that bring the maximum norm of A h below SMALL_NORM; -1 if not finite."""
    norm = 0.0
    for i in range(a.shape[0]):
        total = 0.0
        for j in range(a.shape[0]):
            total += abs(a[i, j])
        if not total * length < SMALL_NORM * 2.0**MOST_DOUBLINGS:
            return -1
        norm = max(norm, total * length)
    return 0 if norm <= SMALL_NORM else math.ceil(math.log2(norm / SMALL_NORM))


@njit(cache=True)
def _series(a, b, h, scratch, step, drive) -> None:  # type: ignore[no-untyped-def]
    """The series of E and G; the last column of `term` is (A h)^j B h / j!."""
    size = a.shape[0]
    term, after = scratch[0], scratch[1]
    step[:] = 0.0
    drive[:] = 0.0
    for i in range(size):
        for j in range(size):
            term[i, j] = 1.0 if i == j else 0.0
        term[i, size] = h * b[i]
    for order in range(TERMS):
        for i in range(size):
            share = term[i, size] / (order + 1.0)
            drive[i, 0] += share
            drive[i, 1] += share / (order + 2.0)
            drive[i, 2] += 2.0 * share / ((order + 2.0) * (order + 3.0))
            for j in range(size + 1):
                total = 0.0
                for k in range(size):
                    total += a[i, k] * term[k, j]
                after[i, j] = h * total / (order + 1.0)
                if j < size:
                    step[i, j] += after[i, j]
        term, after = after, term


@njit(cache=True)
def _double(product, step, drive) -> None:  # type: ignore[no-untyped-def]
    """Propagators of twice the step; product (n, n + 1) is overwritten."""
    size = step.shape[0]
    for k in range(2, -1, -1):
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += step[i, j] * drive[j, k]
            product[i, 0] = total
        for i in range(size):
            g_0, g_1, g_2 = drive[i, 0], drive[i, 1], drive[i, 2]
            if k == 0:
                drive[i, 0] = product[i, 0] + 2.0 * g_0
            elif k == 1:
                drive[i, 1] = 0.5 * (product[i, 0] + 2.0 * g_1 + g_0)
            else:
                drive[i, 2] = 0.25 * (product[i, 0] + 2.0 * g_2 + 2.0 * g_1 + g_0)
    for i in range(size):
        for j in range(size):
            total = 2.0 * step[i, j]
            for k in range(size):
                total += step[i, k] * step[k, j]
            product[i, j] = total
    for i in range(size):
        for j in range(size):
            step[i, j] = product[i, j]
