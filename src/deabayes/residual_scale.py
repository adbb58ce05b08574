"""What a record's residuals are: differences, or ratios where errors grow with the response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray


@dataclass(frozen=True)
class ResidualScale:
    r"""The residual r of a response y about a model's f, and back.

    r = (y - f) / s, or ln(y / f) / s for a response whose errors are in proportion to it.

    The second suits the gain of a frequency response, which spans decades: with the phase's
    difference it is the complex logarithm of measured over modelled response, real and
    imaginary part, so that both may share one law. Noise that is stationary in r is, in the
    gain, largest at the resonance.

    Attributes
    ----------
    scale : s, one for all draws or one per draw (W,).
    proportional : whether r is the logarithm of the ratio.
    """

    scale: FloatArray | float = 1.0
    proportional: bool = False

    def residuals(self, response: FloatArray, mean: FloatArray) -> FloatArray:
        """r (W, N) of y (N,) about f (W, N); NaN where a ratio is not positive."""
        if not self.proportional:
            return np.asarray((response - mean) / self._column)
        with np.errstate(all="ignore"):
            return np.asarray(np.log(response / mean) / self._column)

    def with_residuals(self, mean: FloatArray, residuals: FloatArray) -> FloatArray:
        """y (W, N) whose residuals about f (W, N) are r (W, N)."""
        if not self.proportional:
            return np.asarray(mean + self._column * residuals)
        return np.asarray(mean * np.exp(self._column * residuals))

    def log_derivative(self, response: FloatArray) -> FloatArray:
        """log |dr/dy| at y (N,): what turns a density of r into one of y; (1, N) or (W, N)."""
        at = -np.log(response) if self.proportional else np.zeros_like(response)
        return np.asarray(at - np.log(self._column))

    def level(self, response: FloatArray) -> FloatArray:
        """y (W, N), or ln y: what residuals, times s, are differences of."""
        if not self.proportional:
            return response
        return np.asarray(np.log(np.maximum(response, np.finfo(float).tiny)))

    def in_levels(self, residuals: FloatArray) -> FloatArray:
        """Residuals (W, N) as differences of levels."""
        return np.asarray(self._column * residuals)

    def response(self, level: FloatArray) -> FloatArray:
        """y of levels of any shape."""
        return np.asarray(np.exp(level)) if self.proportional else level

    @property
    def _column(self) -> FloatArray:
        return np.atleast_1d(np.asarray(self.scale, dtype=float))[:, None]
