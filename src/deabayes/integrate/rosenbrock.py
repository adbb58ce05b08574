"""Parts of Rosenbrock-Wanner integration that all kernels share.

The coefficients are in `rodas5p`. A kernel builds its stages from them, for its own right-hand
side and Jacobian. Its innermost loop runs over draws in contiguous lanes. LANES is the fixed
number of draws in a group. Loops of a known length compile to full vectors only, so the
arithmetic of a draw does not depend on its place in a batch.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate import rodas5p
from deabayes.integrate.compiled import njit

LANES = 32
KERNEL_OPTIONS = {
    "cache": True,
    "error_model": "numpy",
    "parallel": False,
    "fastmath": {"contract"},
}
"""Fused multiply-add is allowed; optimisations that assume the absence of NaN are not."""
SAFETY = 0.9
LARGEST_GROWTH = 4.0
LARGEST_CUT = 0.1


@njit(**KERNEL_OPTIONS)
def interpolate(x: float, start: float, end: float, k2: float, k3: float, k4: float) -> float:
    """Dense output at the fraction `x` of a step (order 4)."""
    return (1.0 - x) * start + x * (end + (1.0 - x) * (k2 + x * (k3 + x * k4)))


@njit(**KERNEL_OPTIONS)
def size_factor(error_ratio: float) -> float:
    """Factor to the next step size; `error_ratio` is the error estimate over the allowed error.

    The estimate is of order h^5. NaN (a stage left the model's domain) gives the largest cut.
    """
    if not error_ratio < 1e8:
        return LARGEST_CUT
    factor = SAFETY * max(error_ratio, 1e-8) ** -0.2
    return min(LARGEST_GROWTH, max(LARGEST_CUT, factor))


def transformed_coefficients() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (8, 8), C (8, 8) and the weights (8,) of the end of the step as arrays."""
    a, c = np.zeros((rodas5p.STAGES, rodas5p.STAGES)), np.zeros((rodas5p.STAGES, rodas5p.STAGES))
    for stage in range(rodas5p.STAGES):
        a[stage, :stage], c[stage, :stage] = rodas5p.A[stage], rodas5p.C[stage]
    return a, c, np.array(rodas5p.A[rodas5p.STAGES])
