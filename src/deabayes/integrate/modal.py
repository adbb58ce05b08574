"""Exact response of linear systems as a sum over modes, with or without a charging circuit."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.linear import SERIES, SMALL_STEP, Hold
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, LANES
from deabayes.integrate.state_space import StateSpace

DIRECT, CHARGED = 3, 6
"""Number of terms of a step's input: three of a parabola, and three more with a circuit."""
L, L2, L3, L4, L5 = (n * LANES for n in range(1, 6))
OF_PARABOLA, OF_CHARGE = (0,) * DIRECT, (0,) * CHARGED


@njit(**KERNEL_OPTIONS)
def _moments(x: complex, y: float) -> tuple[complex, complex, complex, complex]:
    """Return e^x, Phi_0, Phi_1 and Phi_2 at complex x and real y."""
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
    """Fill weights (C, m, (1 + terms) 2 LANES): e^{lambda h}, then the weight of every term.

    LANES real parts are followed by LANES imaginary parts.
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
    """Fill the terms x (DIRECT LANES) of a step whose input is the same for all draws."""
    for i in range(LANES):
        x[i] = polynomial[0]
        x[L + i] = polynomial[1]
        x[L2 + i] = polynomial[2]


@njit(**KERNEL_OPTIONS)
def _charge(voltage, charges, circuit, charged, x, outputs) -> None:  # type: ignore[no-untyped-def]
    """Fill the terms x (CHARGED LANES) of a step, move v (LANES) to its end, output D v^2."""
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
def _advance_mode(w, x, residues, q, outputs, terms) -> None:  # type: ignore[no-untyped-def]
    """Advance the mode q (2 LANES) by one step and add its contribution to the outputs.

    `terms` is a tuple with an entry for every term of the input, so the compiler unrolls its loop.
    """
    for i in range(LANES):
        real = w[i] * q[i] - w[L + i] * q[L + i]
        imaginary = w[i] * q[L + i] + w[L + i] * q[i]
        for k in range(len(terms)):
            real += x[k * L + i] * w[(2 + 2 * k) * L + i]
            imaginary += x[k * L + i] * w[(3 + 2 * k) * L + i]
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
                    _advance_mode(weights[c, i], x, residues[block, i], state[i], y, OF_CHARGE)
            else:
                _parabola(polynomials[s], x)
                for i in range(modes):
                    _advance_mode(weights[c, i], x, residues[block, i], state[i], y, OF_PARABOLA)
        for i in range(output_index.size):
            step = output_index[i]
            for lane in range(LANES):
                fed = 0.0 if behind else circuit[lane] * load[i]  # v^2 does not jump
                response[block * LANES + lane, i] = outputs[step, lane] + fed


LARGEST_RESIDUES = 1e3
"""Largest sum |rho / lambda| over |sum rho / lambda|; rounding errors grow with its square."""
ComplexArray = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class Modes:
    """Modes of linear systems, one of each conjugate pair.

    Attributes
    ----------
    rates : lambda (W, m) [1/s], imaginary parts not negative; NaN for matrices that are not finite.
    residues : rho (W, m), doubled for a mode of a pair, and zero where a draw has fewer modes.
    apart : (W,) whether the modes are far enough apart to be summed accurately.
    """

    rates: ComplexArray
    residues: ComplexArray
    apart: NDArray[np.bool_]

    @classmethod
    def of(cls, space: StateSpace) -> Modes:
        """Diagonalise A."""
        finite = np.asarray(
            np.isfinite(space.a).all(axis=(1, 2)) & np.isfinite(space.b).all(axis=1)
        )
        a = np.where(finite[:, None, None], space.a, np.eye(space.b.shape[1]))
        rates, vectors = np.linalg.eig(a)
        rates = rates.astype(complex)
        with np.errstate(all="ignore"):
            residues = np.einsum("wi,win->wn", space.c, vectors) * _solved(vectors, space.b)
            static = residues / rates
            large = np.abs(static).sum(axis=1) > LARGEST_RESIDUES * np.abs(static.sum(axis=1))
        kept = rates.imag >= 0.0
        residues = np.where(kept, np.where(rates.imag > 0.0, 2.0, 1.0) * residues, 0.0)
        order = np.argsort(~kept, axis=1, kind="stable")[:, : int(kept.sum(axis=1).max())]
        rates = np.where(finite[:, None], np.take_along_axis(rates, order, axis=1), np.nan)
        residues = np.take_along_axis(residues, order, axis=1)
        return cls(rates, residues, ~finite | (np.isfinite(residues).all(axis=1) & ~large))


def modal_response(
    space: StateSpace,
    load: Hold,
    gain: FloatArray | None = None,
    decay: FloatArray | None = None,
) -> FloatArray:
    """Output (W, N) for an input that starts at the first knot; the system is at rest before.

    Parameters
    ----------
    load : the input w; with a circuit, the circuit's voltage V, held with power 1.
    gain, decay : g (W,) and kappa (W,) [1/s] of the circuit, if there is one.

    Returns
    -------
    ndarray
        (W, N). A draw with a value that is not finite, or a decay that is not positive,
        gives a row of NaN; no draw changes another's row.
    """
    modes = Modes.of(space)
    response = _by_modes(modes, space.d, load, gain, decay)
    close = ~modes.apart
    if close.any():
        left = StateSpace(space.a[close], space.b[close], space.c[close], space.d[close])
        circuit = () if gain is None or decay is None else (gain[close], decay[close])
        response[close] = left.response(load, *circuit)
    return response


def _solved(vectors: ComplexArray, column: FloatArray) -> ComplexArray:
    """V^-1 B (W, n); NaN where the eigenvectors are linearly dependent."""
    try:
        return np.linalg.solve(vectors, column[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        found = np.full(vectors.shape[:2], np.nan, dtype=complex)
        for draw in range(column.shape[0]):
            if np.linalg.cond(vectors[draw]) < 1.0 / np.finfo(float).eps:
                found[draw] = np.linalg.solve(vectors[draw], column[draw])
        return found


def _by_modes(
    modes: Modes,
    direct: FloatArray,
    load: Hold,
    gain: FloatArray | None,
    decay: FloatArray | None,
) -> FloatArray:
    """Output (W, N) as a sum over the modes."""
    walkers, terms = direct.size, DIRECT
    circuit = np.zeros((walkers, 2))
    if gain is not None and decay is not None:
        terms = CHARGED
        circuit = np.column_stack([gain, np.where(decay > 0.0, decay, np.nan)])
    rates, residues = modes.rates[:, :, None], modes.residues[:, :, None]
    # All blocks have LANES draws, so the result of a draw does not depend on the other draws.
    blocks = -(-walkers // LANES)
    response = np.empty((blocks * LANES, load.input.size))
    advance_modes(
        load.lengths,
        load.length_index,
        load.polynomials,
        load.output_index,
        load.input,
        _in_lanes(np.concatenate([rates.real, rates.imag], axis=2), blocks),
        _in_lanes(np.concatenate([residues.real, residues.imag], axis=2), blocks),
        _in_lanes(np.column_stack([direct, circuit])[:, None], blocks),
        terms,
        response,
    )
    return response[:walkers]


def _in_lanes(values: FloatArray, blocks: int) -> FloatArray:
    """Reshape (W, K, P) to (blocks, K, P LANES); pad the last block with the last draw."""
    draws = np.minimum(np.arange(blocks * LANES), values.shape[0] - 1)
    lanes = values[draws].reshape(blocks, LANES, *values.shape[1:]).transpose(0, 2, 3, 1)
    return np.ascontiguousarray(lanes).reshape(blocks, values.shape[1], -1)
