r"""Exact response of linear systems in their modes, driven directly or behind a circuit.

With the eigenvalues lambda_i of A and the residues rho_i = (C V)_i (V^-1 B)_i, V the
eigenvectors, z' = A z + B w and y = C z + D w become

q_i' = lambda_i q_i + w,   y = Re sum_i rho_i q_i + D w,

of a pair of conjugate modes one, its residue doubled. On a step of length h (u = s / h)

q_i(h) = e^{lambda h} q_i(0) + sum_k p_k h Phi_k(lambda h, 0)       for w = sum_k p_k u^k,
Phi_k(x, y) = \int_0^1 e^{x (1 - u) - y u} u^k du.

Behind a circuit (see `charged`) v = a_0 + a_1 u + r e^{-kappa s} and w = v^2, which adds
h times 2 r a_0 Phi_0 + 2 r a_1 Phi_1 at (lambda h, kappa h) and r^2 Phi_0 at (lambda h,
2 kappa h). By parts, with d = x + y, Phi_0 = (e^x - e^-y) / d, Phi_k = (k Phi_{k-1} - e^-y) / d;
where d is small, e^-y times the series of `linear`, and the same relation backwards.

Where two modes nearly coincide their residues grow without bound and cancel; such draws are
left to `state_space` and `charged`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.charged import charged_response
from deabayes.integrate.linear import Hold
from deabayes.integrate.modal_lanes import CHARGED, DIRECT, LANES, advance_modes
from deabayes.integrate.state_space import StateSpace

LARGEST_RESIDUES = 1e3
"""Of sum |rho / lambda| over |sum rho / lambda|: eigenvalues' rounding costs its square."""
ComplexArray = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class Modes:
    """Modes of linear systems, one of each conjugate pair.

    Attributes
    ----------
    rates : lambda (W, m) [1/s], imaginary parts not negative; NaN for matrices that are not finite.
    residues : rho (W, m), doubled for one of a pair and zero where a draw has fewer modes.
    apart : (W,) whether the modes are far enough apart to be summed.
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
    """The output (W, N) for an input that starts, with all at rest, at the first knot.

    Parameters
    ----------
    load : the input w; behind a circuit its voltage V, held with power 1.
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
        if gain is None or decay is None:
            response[close] = left.response(load)
        else:
            response[close] = charged_response(left, gain[close], decay[close], load)
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
    """The sum over modes (W, N)."""
    walkers, terms = direct.size, DIRECT
    circuit = np.zeros((walkers, 2))
    if gain is not None and decay is not None:
        terms = CHARGED
        circuit = np.column_stack([gain, np.where(decay > 0.0, decay, np.nan)])
    rates, residues = modes.rates[:, :, None], modes.residues[:, :, None]
    # Every block has all its lanes, so a draw is computed alike in any company.
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
    """(W, K, P) to (blocks, K, P LANES), the last block filled with its last draw."""
    draws = np.minimum(np.arange(blocks * LANES), values.shape[0] - 1)
    lanes = values[draws].reshape(blocks, LANES, *values.shape[1:]).transpose(0, 2, 3, 1)
    return np.ascontiguousarray(lanes).reshape(blocks, values.shape[1], -1)
