"""Kernels of `modal`: draws in lanes, a parabola and, behind a circuit, three terms more.

What belongs to one mode lies in one array, a quantity after another and each with its lanes
side by side, at distances the compiler knows: only so does it use vectors.
"""

from __future__ import annotations

import cmath
import math

import numpy as np

from deabayes.compiled import njit
from deabayes.integrate.linear import SERIES, SMALL_STEP
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS
from deabayes.integrate.rosenbrock import LANES as LANES

DIRECT, CHARGED = 3, 6
"""Terms of a step's input: a parabola, and with it the three of a circuit."""
L, L2, L3, L4, L5, L6, L7 = (n * LANES for n in range(1, 8))
L8, L9, L10, L11, L12, L13 = (n * LANES for n in range(8, 14))


@njit(**KERNEL_OPTIONS)
def _moments(x: complex, y: float) -> tuple[complex, complex, complex, complex]:
    """e^x, and Phi_0, Phi_1 and Phi_2 at complex x and real y."""
    d, left = x + y, math.exp(-y)
    grown = cmath.exp(x)
    if abs(d) < SMALL_STEP:
        total = 0.0 * d
        for coefficient in SERIES[::-1]:
            total = total * -d + coefficient
        one = 0.5 * (1.0 + d * total)
        return grown, left * (1.0 + d * one), left * one, left * total
    zero = (grown - left) / d
    one = (zero - left) / d
    return grown, zero, one, (2.0 * one - left) / d


@njit(**KERNEL_OPTIONS)
def _put(weights, term, lane, value) -> None:  # type: ignore[no-untyped-def]
    weights[2 * term * LANES + lane] = value.real
    weights[(2 * term + 1) * LANES + lane] = value.imag


@njit(**KERNEL_OPTIONS)
def _fill(lengths, rates, circuit, terms, weights, charges) -> None:  # type: ignore[no-untyped-def]
    """Weights (C, m, (1 + terms) 2 LANES): e^{lambda h} and the terms', real beside imaginary.

    charges (C, 2 LANES): e^{-kappa h} and 1 / (kappa h) of the circuit.
    """
    for c in range(lengths.size):
        h = lengths[c]
        for lane in range(LANES):
            z = circuit[L2 + lane] * h
            charges[c, lane], charges[c, L + lane] = math.exp(-z), 1.0 / z
            for i in range(rates.shape[0]):
                x, found = complex(rates[i, lane], rates[i, L + lane]) * h, weights[c, i]
                grown, zero, one, two = _moments(x, 0.0)
                _put(found, 0, lane, grown)
                _put(found, 1, lane, h * zero)
                _put(found, 2, lane, h * one)
                _put(found, 3, lane, h * two)
                if terms == CHARGED:
                    _, zero, one, _ = _moments(x, z)
                    _put(found, 4, lane, h * zero)
                    _put(found, 5, lane, h * one)
                    _put(found, 6, lane, h * _moments(x, 2.0 * z)[1])


@njit(**KERNEL_OPTIONS)
def _parabola(polynomial, x) -> None:  # type: ignore[no-untyped-def]
    """The terms (DIRECT LANES) of a step whose input all draws share."""
    for i in range(LANES):
        x[i] = polynomial[0]
        x[L + i] = polynomial[1]
        x[L2 + i] = polynomial[2]


@njit(**KERNEL_OPTIONS)
def _charge(voltage, charges, circuit, charged, x, outputs) -> None:  # type: ignore[no-untyped-def]
    """The terms (CHARGED LANES) of one step, v (LANES) moved to its end, and D v^2 there."""
    for i in range(LANES):
        a_0 = circuit[L + i] * (voltage[0] - voltage[1] * charges[L + i])
        a_1 = circuit[L + i] * voltage[1]
        r = charged[i] - a_0
        x[i] = a_0 * a_0
        x[L + i] = 2.0 * a_0 * a_1
        x[L2 + i] = a_1 * a_1
        x[L3 + i] = 2.0 * r * a_0
        x[L4 + i] = 2.0 * r * a_1
        x[L5 + i] = r * r
        v = a_0 + a_1 + r * charges[i]
        charged[i] = v
        outputs[i] = circuit[i] * v * v


@njit(**KERNEL_OPTIONS)
def _direct(w, x, residues, q, outputs) -> None:  # type: ignore[no-untyped-def]
    """Move the mode q (2 LANES) by a step and add what it contributes."""
    for i in range(LANES):
        real = w[i] * q[i] - w[L + i] * q[L + i]
        imaginary = w[i] * q[L + i] + w[L + i] * q[i]
        real += x[i] * w[L2 + i] + x[L + i] * w[L4 + i] + x[L2 + i] * w[L6 + i]
        imaginary += x[i] * w[L3 + i] + x[L + i] * w[L5 + i] + x[L2 + i] * w[L7 + i]
        q[i] = real
        q[L + i] = imaginary
        outputs[i] += residues[i] * real - residues[L + i] * imaginary


@njit(**KERNEL_OPTIONS)
def _driven(w, x, residues, q, outputs) -> None:  # type: ignore[no-untyped-def]
    """The same with the terms of a circuit."""
    for i in range(LANES):
        real = w[i] * q[i] - w[L + i] * q[L + i]
        imaginary = w[i] * q[L + i] + w[L + i] * q[i]
        real += x[i] * w[L2 + i] + x[L + i] * w[L4 + i] + x[L2 + i] * w[L6 + i]
        imaginary += x[i] * w[L3 + i] + x[L + i] * w[L5 + i] + x[L2 + i] * w[L7 + i]
        real += x[L3 + i] * w[L8 + i] + x[L4 + i] * w[L10 + i] + x[L5 + i] * w[L12 + i]
        imaginary += x[L3 + i] * w[L9 + i] + x[L4 + i] * w[L11 + i] + x[L5 + i] * w[L13 + i]
        q[i] = real
        q[L + i] = imaginary
        outputs[i] += residues[i] * real - residues[L + i] * imaginary


@njit(**KERNEL_OPTIONS)
def advance_modes(  # type: ignore[no-untyped-def]
    lengths,
    length_index,
    polynomials,
    output_index,
    load,
    rates,
    residues,
    vectors,
    terms,
    response,
) -> None:
    """Fill response (blocks * LANES, N), one block of lanes after another.

    rates and residues (blocks, m, 2 LANES): real, then imaginary parts; vectors (blocks, 1,
    3 LANES): D, g and kappa.
    """
    modes, behind = rates.shape[1], terms == CHARGED
    weights = np.empty((lengths.size, modes, (1 + terms) * L2))
    charges = np.empty((lengths.size, L2))
    outputs = np.empty((length_index.size + 1, LANES))
    state, x, charged = np.empty((modes, L2)), np.empty(terms * LANES), np.empty(LANES)
    for block in range(rates.shape[0]):
        circuit = vectors[block, 0]
        _fill(lengths, rates[block], circuit, terms, weights, charges)
        state[:], charged[:], outputs[:] = 0.0, 0.0, 0.0
        for s in range(length_index.size):
            c, y = length_index[s], outputs[s + 1]
            if behind:
                _charge(polynomials[s], charges[c], circuit, charged, x, y)
                for i in range(modes):
                    _driven(weights[c, i], x, residues[block, i], state[i], y)
            else:
                _parabola(polynomials[s], x)
                for i in range(modes):
                    _direct(weights[c, i], x, residues[block, i], state[i], y)
        for i in range(output_index.size):
            step = output_index[i]
            for lane in range(LANES):
                fed = 0.0 if behind else circuit[lane] * load[i]  # v^2 does not jump
                response[block * LANES + lane, i] = outputs[step, lane] + fed
